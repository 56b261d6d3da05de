"""How many numbers a linear code of a scene's features needs."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Features = NDArray[np.float32]
Floats = NDArray[np.float64]

SHARE = 0.95
"""Of the rows that are to come back alike enough: few of thousands of views may be odd."""

_ROWS_AT_ONCE = 2**12


@dataclass(frozen=True)
class Need:
    """How many numbers are needed, and why.

    Attributes:
        dims: the least number with which ``SHARE`` of the rows come back.
        share: (D,) share of the rows that come back with 1, 2, ... numbers; 1 where there is no row.
    """

    dims: int
    share: Floats


def needed_dims(features: Features, mean: Floats, basis: Floats, least_cosine: float) -> Need:
    """The least number of principal directions by which rows come back with a cosine of at least a bound.

    Args:
        features: (R, D) finite. mean: (D,). basis: (D, D) orthonormal columns, the most important first.
        least_cosine: above 0, at most 1. All D numbers are taken where no fewer do, as for 1.
    """
    good = np.zeros(len(mean))
    for cosines in _cosines(features, mean, basis):
        good += (cosines >= least_cosine).sum(axis=0)
    share = good / len(features) if len(features) else np.ones(len(mean))
    enough = np.flatnonzero(share >= SHARE)
    return Need(int(enough[0]) + 1 if len(enough) else len(mean), share)


def _cosines(features: Features, mean: Floats, basis: Floats) -> Iterator[Floats]:
    """(B, D) cosine of rows with what the first 1, 2, ... directions bring back, some rows at a time."""
    along = mean @ basis
    for begin in range(0, len(features), _ROWS_AT_ONCE):
        rows = features[begin : begin + _ROWS_AT_ONCE].astype(np.float64)
        codes = (rows - mean) @ basis
        # Of x and its return y = mean + sum of c_i b_i, summed up direction by direction.
        product = (rows @ mean)[:, None] + np.cumsum((rows @ basis) * codes, axis=1)
        square = mean @ mean + np.cumsum(codes * (2 * along + codes), axis=1)
        lengths = np.linalg.norm(rows, axis=1)[:, None] * np.sqrt(square.clip(0.0))
        yield np.divide(product, lengths, out=np.zeros_like(product), where=lengths > 0)

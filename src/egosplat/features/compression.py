"""Compression of features to codes of few channels: none, a linear basis, or LangSplat's autoencoder."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from egosplat.codes.decoder import Decoder
from egosplat.errors import UserError
from egosplat.features.autoencoder import fit_autoencoder

Features = NDArray[np.float32]


Floats = NDArray[np.float64]


SHARE = 0.95
"""Of the rows that are to come back alike enough: few of thousands of views may be odd."""


_ROWS_AT_ONCE = 2**14


_COSINES_AT_ONCE = 2**12


@dataclass(frozen=True)
class Need:
    """How many numbers are needed, and why.

    Attributes:
        dims: the least number with which ``SHARE`` of the rows come back.
        share: (D,) share of the rows that come back with 1, 2, ... numbers; 1 where there is no row.
    """

    dims: int
    share: Floats


@dataclass(frozen=True)
class Compression:
    """A fitted compression.

    Attributes:
        encode: (R, D) float32 features -> (R, C) float32 codes.
        decoder: brings codes back.
        need: why codes have their length, where the features decided it.
    """

    encode: Callable[[Features], Features]
    decoder: Decoder
    need: Need | None = None


def fit(
    features: Features, kind: str, dims: int | str, epochs: int, seed: int, least_cosine: float = 1.0
) -> Compression:
    """Fit a compression to features.

    Args:
        features: (R, D) float32, finite; every row counts the same.
        kind: ``none``, ``linear`` or ``autoencoder``.
        dims: C, or ``auto`` for as few as a linear basis needs, whatever the kind; of no meaning for ``none``.
        epochs, seed: of the autoencoder's training.
        least_cosine: what ``auto`` asks of features that come back.

    Raises:
        UserError: C is more than D, or training diverges.
    """
    width = features.shape[1]
    if kind == "none":
        return Compression(np.copy, Decoder((width,), np.zeros(0, np.float32)))
    if isinstance(dims, str):
        basis = fit_linear(features, None, least_cosine)
        if kind == "linear":
            return basis
        return replace(fit(features, kind, basis.need.dims, epochs, seed), need=basis.need)
    if dims > width:
        raise UserError(
            f"features.dims = {dims}: OpenCLIP's features have {width} channels; set at most that"
        )
    if kind == "linear":
        return fit_linear(features, dims)
    if kind == "autoencoder":
        return Compression(*fit_autoencoder(features, dims, epochs, seed))
    raise ValueError(f"compression {kind!r} is unknown")


def fit_linear(features: Features, dims: int | None, least_cosine: float = 1.0) -> Compression:
    """The mean of the rows and their ``dims`` principal directions: of all linear codes, the least squared error.

    Without ``dims`` as many as bring rows back with a cosine of at least ``least_cosine``: see ``needed_dims``.
    A basis vector points to where its largest component is positive, so that equal rows give equal codes.
    """
    width = features.shape[1]
    mean, scatter = np.zeros(width), np.zeros((width, width))
    for rows in _blocks(features):
        mean += rows.sum(axis=0) / len(features)
    for rows in _blocks(features):
        scatter += (rows - mean).T @ (rows - mean)
    basis = np.linalg.eigh(scatter)[1][:, ::-1]
    need = needed_dims(features, mean, basis, least_cosine) if dims is None else None
    dims = need.dims if dims is None else dims
    basis = basis[:, :dims]
    largest = np.abs(basis).argmax(axis=0)
    basis *= np.sign(basis[largest, np.arange(dims)])

    def encode(rows: Features) -> Features:
        return ((rows.astype(np.float64) - mean) @ basis).astype(np.float32)

    values = np.concatenate([basis.ravel(), mean]).astype(np.float32)
    return Compression(encode, Decoder((dims, width), values), need)


def _blocks(features: Features) -> Iterator[NDArray[np.float64]]:
    """The rows in float64, few enough at a time."""
    for begin in range(0, len(features), _ROWS_AT_ONCE):
        yield features[begin : begin + _ROWS_AT_ONCE].astype(np.float64)


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
    for begin in range(0, len(features), _COSINES_AT_ONCE):
        rows = features[begin : begin + _COSINES_AT_ONCE].astype(np.float64)
        codes = (rows - mean) @ basis
        # Of x and its return y = mean + sum of c_i b_i, summed up direction by direction.
        product = (rows @ mean)[:, None] + np.cumsum((rows @ basis) * codes, axis=1)
        square = mean @ mean + np.cumsum(codes * (2 * along + codes), axis=1)
        lengths = np.linalg.norm(rows, axis=1)[:, None] * np.sqrt(square.clip(0.0))
        yield np.divide(product, lengths, out=np.zeros_like(product), where=lengths > 0)

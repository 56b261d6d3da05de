"""Compression of features to codes of few channels: none, a linear basis, or LangSplat's autoencoder."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.features.autoencoder import fit_autoencoder
from egosplat.features.decoding import Decoder

Features = NDArray[np.float32]

_ROWS_AT_ONCE = 2**14


@dataclass(frozen=True)
class Compression:
    """A fitted compression.

    Attributes:
        encode: (R, D) float32 features -> (R, C) float32 codes.
        decoder: brings codes back.
    """

    encode: Callable[[Features], Features]
    decoder: Decoder


def fit(features: Features, kind: str, dims: int, epochs: int, seed: int) -> Compression:
    """Fit a compression to features.

    Args:
        features: (R, D) float32, finite; every row counts the same.
        kind: ``none``, ``linear`` or ``autoencoder``.
        dims: C; of no meaning for ``none``.
        epochs, seed: of the autoencoder's training.

    Raises:
        UserError: C is more than D, or training diverges.
    """
    width = features.shape[1]
    if kind == "none":
        return Compression(np.copy, Decoder((width,), np.zeros(0, np.float32)))
    if dims > width:
        raise UserError(
            f"features.dims = {dims}: OpenCLIP's features have {width} channels; set at most that"
        )
    if kind == "linear":
        return fit_linear(features, dims)
    if kind == "autoencoder":
        return Compression(*fit_autoencoder(features, dims, epochs, seed))
    raise ValueError(f"compression {kind!r} is unknown")


def fit_linear(features: Features, dims: int) -> Compression:
    """The mean of the rows and their ``dims`` principal directions: of all linear codes, the least squared error.

    A basis vector points to where its largest component is positive, so that equal rows give equal codes.
    """
    width = features.shape[1]
    mean, scatter = np.zeros(width), np.zeros((width, width))
    for rows in _blocks(features):
        mean += rows.sum(axis=0) / len(features)
    for rows in _blocks(features):
        scatter += (rows - mean).T @ (rows - mean)
    basis = np.linalg.eigh(scatter)[1][:, ::-1][:, :dims]
    largest = np.abs(basis).argmax(axis=0)
    basis *= np.sign(basis[largest, np.arange(dims)])

    def encode(rows: Features) -> Features:
        return ((rows.astype(np.float64) - mean) @ basis).astype(np.float32)

    values = np.concatenate([basis.ravel(), mean]).astype(np.float32)
    return Compression(encode, Decoder((dims, width), values))


def _blocks(features: Features) -> Iterator[NDArray[np.float64]]:
    """The rows in float64, few enough at a time."""
    for begin in range(0, len(features), _ROWS_AT_ONCE):
        yield features[begin : begin + _ROWS_AT_ONCE].astype(np.float64)

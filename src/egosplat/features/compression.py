"""Compression of features to codes of few channels: none, a linear basis, or LangSplat's autoencoder."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from egosplat.codes.decoder import Decoder
from egosplat.errors import UserError
from egosplat.features.autoencoder import fit_autoencoder
from egosplat.features.dimensions import Need, needed_dims

Features = NDArray[np.float32]

_ROWS_AT_ONCE = 2**14


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

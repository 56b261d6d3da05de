"""Compress features to codes with few channels: none, a linear basis, or LangSplat's autoencoder."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from egosplat.arrays import Array, Floats
from egosplat.errors import UserError
from egosplat.features.autoencoder import fit_autoencoder
from egosplat.features.supervision import parts_of
from egosplat.language.decoder import Decoder

# Fraction of rows that must be reconstructed where dims is auto, and their least cosine. A few of thousands of views may be unusual.
SHARE, LEAST_COSINE = 0.95, 0.99

# Rows per block: cosines need several arrays in float64.
_COSINES_AT_ONCE = 2**12


@dataclass(frozen=True)
class Compression:
    """A fitted compression: (R, D) float32 features -> (R, C) float32 codes, and back."""

    encode: Callable[[Floats], Floats]
    decoder: Decoder


def fit(features: Floats, kind: str, dims: int | str, epochs: int, seed: int) -> Compression:
    """Fit a compression to features (UserError: C exceeds D, or training diverges).

    Args:
        features: (R, D) float32, finite, equally weighted.
        kind: ``none``, ``linear`` or ``autoencoder``.
        dims: C, or ``auto`` for the fewest that a linear basis needs, for any kind; ignored for ``none``.
        epochs, seed: for the autoencoder's training.
    """
    width = features.shape[1]
    if kind == "none":
        return Compression(np.copy, Decoder((width,), np.zeros(0, np.float32)))
    if isinstance(dims, str):
        # A linear basis decides for the autoencoder, too: otherwise each length would need a training.
        basis = fit_linear(features, None)
        return basis if kind == "linear" else fit(features, kind, basis.decoder.widths[0], epochs, seed)
    if dims > width:
        raise UserError(
            f"features.dims = {dims}: OpenCLIP's features have {width} channels; use at most {width}"
        )
    if kind == "linear":
        return fit_linear(features, dims)
    if kind == "autoencoder":
        return Compression(*fit_autoencoder(features, dims, epochs, seed))
    raise ValueError(f"compression {kind!r} is unknown")


def fit_linear(features: Floats, dims: int | None) -> Compression:
    """Fit the mean and ``dims`` principal directions, at most all: the linear code with the least squared error.
    Without ``dims``, uses as many as ``needed_dims`` returns."""
    width = features.shape[1]
    # Two passes, because sums of squares minus the squared mean would cancel.
    mean, scatter = np.zeros(width), np.zeros((width, width))
    for part in parts_of(len(features)):
        mean += features[part].astype(np.float64).sum(axis=0) / len(features)
    for part in parts_of(len(features)):
        rows = features[part].astype(np.float64)
        scatter += (rows - mean).T @ (rows - mean)
    # eigh sorts eigenvalues in ascending order; the largest variance comes first here.
    basis = np.linalg.eigh(scatter)[1][:, ::-1]
    dims = needed_dims(features, mean, basis) if dims is None else min(dims, width)
    basis = basis[:, :dims]
    # The sign of an eigenvector is arbitrary: the largest component is made positive, so equal rows give equal codes.
    largest = np.abs(basis).argmax(axis=0)
    basis *= np.sign(basis[largest, np.arange(dims)])

    def encode(rows: Floats) -> Floats:
        codes = np.empty((len(rows), basis.shape[1]), np.float32)
        for part in parts_of(len(rows)):
            codes[part] = (rows[part].astype(np.float64) - mean) @ basis
        return codes

    values = np.concatenate([basis.ravel(), mean]).astype(np.float32)
    return Compression(encode, Decoder((dims, width), values))


def needed_dims(features: Floats, mean: Array, basis: Array) -> int:
    """Return the fewest principal directions that reconstruct a fraction ``SHARE`` of (R, D) rows with at least
    the cosine ``LEAST_COSINE``, or all. ``mean`` is (D,), ``basis`` (D, D) orthonormal columns, most important first."""
    along, good = mean @ basis, np.zeros(len(mean))
    for begin in range(0, len(features), _COSINES_AT_ONCE):
        rows = features[begin : begin + _COSINES_AT_ONCE].astype(np.float64)
        codes = (rows - mean) @ basis
        # Accumulated direction by direction, for x and its reconstruction y = mean + sum of c_i b_i.
        product = (rows @ mean)[:, None] + np.cumsum((rows @ basis) * codes, axis=1)
        square = mean @ mean + np.cumsum(codes * (2 * along + codes), axis=1)
        lengths = np.linalg.norm(rows, axis=1)[:, None] * np.sqrt(square.clip(0.0))
        cosines = np.divide(product, lengths, out=np.zeros_like(product), where=lengths > 0)
        good += (cosines >= LEAST_COSINE).sum(axis=0)
    share = good / len(features) if len(features) else np.ones(len(mean))
    enough = np.flatnonzero(share >= SHARE)
    return int(enough[0]) + 1 if len(enough) else len(mean)

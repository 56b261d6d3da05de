"""What compression loses, as figures for the facts."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.codes.decoder import Decoder, decode
from egosplat.codes.vectors import unit

Features = NDArray[np.float32]

_ROWS_AT_ONCE = 2**14


def reconstruction(features: Features, codes: Features, decoder: Decoder) -> NDArray[np.float64]:
    """(R,) cosine of each feature with what its code is decoded to; 0 where either vanishes."""
    cosines = [np.zeros(0)]
    for begin in range(0, len(features), _ROWS_AT_ONCE):
        part = slice(begin, begin + _ROWS_AT_ONCE)
        decoded = decode(torch.from_numpy(codes[part]), decoder).numpy()
        cosines.append((unit(features[part]) * unit(decoded)).sum(axis=1))
    return np.concatenate(cosines)


def agreement(views: Features, consistent: Features, instance: NDArray[np.integer]) -> float | None:
    """Mean cosine of each view's feature with its instance's consistent feature; None without any view.

    Args:
        views: (R, D); consistent: (N, D); instance: (R,) of each view.
    """
    total = 0.0
    for begin in range(0, len(views), _ROWS_AT_ONCE):
        part = slice(begin, begin + _ROWS_AT_ONCE)
        total += float((unit(views[part]) * unit(consistent[instance[part]])).sum())
    return total / len(views) if len(views) else None


def spread(features: Features) -> float | None:
    """Mean cosine between two different ones of (N, D) features; None for fewer than two.

    1 where all are the same, which is what too few dimensions lead to (docs/method.md#code-dimensions).
    """
    count = len(features)
    if count < 2:
        return None
    total = unit(features).sum(axis=0)
    return float((total @ total - count) / (count * (count - 1)))


def summary(cosines: NDArray[np.float64], level: NDArray[np.integer], names: Sequence[str]) -> dict[str, Any]:
    """Mean and lowest cosine of all rows, and of those of each level.

    Args:
        cosines: (R,); level: (R,) index into the names.
    """
    by_level = {name: _figures(cosines[level == number]) for number, name in enumerate(names)}
    return {**_figures(cosines), "by_level": by_level}


def _figures(cosines: NDArray[np.float64]) -> dict[str, float | None]:
    if not len(cosines):
        return {"mean": None, "lowest": None}
    return {"mean": float(cosines.mean()), "lowest": float(cosines.min())}

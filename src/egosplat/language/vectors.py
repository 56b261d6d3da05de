"""Normalize feature vectors of any scale."""

import numpy as np

from egosplat.arrays import Array, Bools, Reals


def usable(features: Reals) -> Bools:
    """(R,) bool: features of (R, D) with a direction: all numbers finite, not all 0."""
    return np.isfinite(features).all(axis=-1) & (features != 0).any(axis=-1)


def unit(features: Reals) -> Array:
    """Normalize (..., D) features in float64; zero features stay 0."""
    values = features.astype(np.float64)
    # Divided by the largest number first, so that no square overflows or underflows.
    largest = np.abs(values).max(axis=-1, keepdims=True, initial=0.0)
    values /= np.where(largest > 0, largest, 1.0)
    norm = np.linalg.norm(values, axis=-1, keepdims=True)
    return values / np.where(norm > 0, norm, 1.0)

"""The supervision of Gaussians: a view's own feature, the consistent feature, or their average."""

import math

import numpy as np
from numpy.typing import NDArray

from egosplat.codes.vectors import unit

Floats = NDArray[np.floating]
Bools = NDArray[np.bool_]

TARGETS = ("average", "consistent", "view")


def supervise(
    own: Floats, consistent: Floats, inlier: Bools, mismatched: Bools, target: str, outlier_target: str
) -> Floats:
    """Return the supervision of R views, before normalization.

    Args:
        own: (R, D) features of the views.
        consistent: (R, D) consistent features of their instances.
        inlier: (R,) views that agree with their instance.
        mismatched: (R,) views that use their own feature instead of an average.
        target: one of ``TARGETS``; ``average`` is the paper's.
        outlier_target: target of an outlier under ``average``: ``consistent`` or ``average``
            (docs/method.md#supervision-average).
    """
    if target == "view":
        return own
    if target == "consistent":
        return consistent
    mixed = (own + consistent) / 2
    averaged = mixed if outlier_target == "average" else np.where(inlier[:, None], mixed, consistent)
    return np.where(mismatched[:, None], own, averaged)


def agreement_limit(apart: float | None) -> float:
    """Return the cosine with the consistent feature below which a view shows another object.

    Args:
        apart: mean cosine between consistent features of different instances.

    Returns:
        The midpoint of ``apart`` and 1; minus infinity if ``apart`` is None (fewer than two instances).
    """
    return -math.inf if apart is None else (1 + apart) / 2


def consistent_directions(consistent: Floats, own: Floats, instance: NDArray[np.integer]) -> Floats:
    """Normalize (N, D) consistent features.

    Args:
        consistent: (N, D) float64.
        own: (R, D) features of the views.
        instance: (R,) instance of each view, sorted.
    """
    owners, first = np.unique(instance, return_index=True)
    directions = unit(consistent)
    # Views may cancel, as two opposite ones do. The instance then takes its first view's direction.
    lost = vanishing(consistent[owners])
    directions[owners[lost]] = unit(own[first[lost]])
    return directions


def vanishing(features: Floats) -> Bools:
    """(R,) bool: features whose norm is rounding error, as averages of unit vectors."""
    return np.linalg.norm(features, axis=-1) < 1e-6

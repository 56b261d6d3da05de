"""What the Gaussians are supervised with: of each view its own feature, the consistent one, or their average."""

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
    """The supervision of R views, before it is brought to unit norm.

    Args:
        own: (R, D) features of the views.
        consistent: (R, D) those of their instances.
        inlier: (R,) views that agree with their instance.
        mismatched: (R,) views that take their own feature in place of an average.
        target: one of ``TARGETS``; ``average`` is the paper's.
        outlier_target: for an average, what an outlier takes: ``consistent``, that alone, or ``average``
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
    """The cosine with its instance's consistent feature below which a view shows another thing: half way from that of
    different instances to 1; minus infinity where there are no two to compare.

    Args:
        apart: mean cosine between the consistent features of different instances.
    """
    return -math.inf if apart is None else (1 + apart) / 2


def consistent_directions(consistent: Floats, own: Floats, instance: NDArray[np.integer]) -> Floats:
    """(N, D) consistent features of unit norm.

    Views that cancel, as two opposite ones do, leave no direction: the instance then has its first view's.

    Args:
        consistent: (N, D) float64; own: (R, D) views, instance: (R,) of each, sorted.
    """
    owners, first = np.unique(instance, return_index=True)
    directions = unit(consistent)
    lost = vanishing(consistent[owners])
    directions[owners[lost]] = unit(own[first[lost]])
    return directions


def vanishing(features: Floats) -> Bools:
    """(R,) which features are so short, beside the unit vectors they were averaged of, that they are rounding."""
    return np.linalg.norm(features, axis=-1) < 1e-6

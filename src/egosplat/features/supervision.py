"""The supervision of Gaussians: a view's own feature, the consistent feature, or their average; its figures."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from egosplat.arrays import Array, Bools, Floats, Ints32, Reals
from egosplat.features.aggregation import Aggregate
from egosplat.features.options import FeaturesOptions
from egosplat.language.vectors import unit

# Rows that are held in float64 at a time: 64 MiB at 512 channels.
_ROWS_AT_ONCE = 2**14


def supervise_views(
    feature: Floats, instance: Ints32, found: Aggregate, options: FeaturesOptions
) -> tuple[Floats, Floats, Array, Bools]:
    """The supervision of (R, D) features of views, in their place, (N, D) consistent features, (R,) cosines to them, mismatched flags."""
    # Means of unit norm: similarity to text depends on the direction alone (docs/method.md#unit-norm).
    consistent = consistent_directions(found.feature, feature, instance)
    # A view whose cosine is below the midpoint of 1 and that between instances shows another object. Measured with the
    # small models' tracks alone (docs/method.md#mismatched); the paper makes no exception.
    excepts = options.supervision != "average" and options.set not in ("light", "published")
    apart = spread(consistent[found.views > 0]) if excepts else None
    limit = -math.inf if apart is None else (1 + apart) / 2
    agreement = cosines(feature, lambda part: consistent[instance[part]])
    for part in parts_of(len(feature)):
        own, common = feature[part].astype(np.float64), consistent[instance[part]]
        values = supervise(own, common, found.inlier[part], agreement[part] < limit, options.supervision)
        # Opposite features cancel; the average then has no direction of its own.
        feature[part] = unit(np.where(vanishing(values)[:, None], common, values))
    return feature, consistent.astype(np.float32), agreement, agreement < limit


def supervise(own: Reals, consistent: Reals, inlier: Bools, mismatched: Bools, target: str) -> Reals:
    """Return the supervision of R views, before normalization.

    Args:
        own: (R, D) features of the views.
        consistent: (R, D) consistent features of their instances.
        inlier: (R,) views that agree with their instance.
        mismatched: (R,) views that use their own feature instead of an average.
        target: ``average``, the paper's, ``inliers``, ``consistent`` or ``view`` (docs/method.md#supervision-average).
    """
    if target == "view":
        return own
    if target == "consistent":
        return consistent
    # The paper's average. An outlier would keep half of its wrong feature, so the consistent one replaces it.
    mixed = (own + consistent) / 2
    averaged = mixed if target == "average" else np.where(inlier[:, None], mixed, consistent)
    return np.where(mismatched[:, None], own, averaged)


def consistent_directions(consistent: Reals, own: Reals, instance: NDArray[np.integer]) -> Reals:
    """Normalize (N, D) float64 consistent features of the (R, D) ``own`` ones of views, sorted by ``instance`` (R,)."""
    owners, first = np.unique(instance, return_index=True)
    directions = unit(consistent)
    # Views may cancel, as two opposite ones do. The instance then takes its first view's direction.
    lost = vanishing(consistent[owners])
    directions[owners[lost]] = unit(own[first[lost]])
    return directions


def vanishing(features: Reals) -> Bools:
    """(R,) bool: features whose norm is rounding error, as averages of unit vectors."""
    # About ten times the rounding of float32, in which the views are stored.
    return np.linalg.norm(features, axis=-1) < 1e-6


def parts_of(count: int) -> list[slice]:
    """Slices of so many rows, each small enough to be held in float64."""
    return [slice(begin, begin + _ROWS_AT_ONCE) for begin in range(0, count, _ROWS_AT_ONCE)]


def cosines(features: Floats, others: Callable[[slice], Reals]) -> Array:
    """(R,) cosine of each of (R, D) features with what ``others`` returns for some rows; 0 if either vanishes."""
    parts = [(unit(features[part]) * unit(others(part))).sum(axis=1) for part in parts_of(len(features))]
    return np.concatenate([np.zeros(0), *parts])


def mean_cosine(features: Floats, others: Callable[[slice], Reals]) -> float | None:
    """Mean of ``cosines``; None without a row."""
    return float(cosines(features, others).mean()) if len(features) else None


def spread(features: Floats) -> float | None:
    """Mean cosine between different rows of (N, D) features; None for fewer than two. It is 1 if all are
    equal, which too few code channels cause (docs/method.md#code-dimensions)."""
    count = len(features)
    if count < 2:
        return None
    total = unit(features).sum(axis=0)
    # The squared norm of the sum contains all pairs, and each row with itself.
    return float((total @ total - count) / (count * (count - 1)))

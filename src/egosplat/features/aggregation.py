"""Consistent features: the mean of an instance's views without outliers (docs/method.md#aggregation).

For views F_j with channel-wise median F~ and deviations d_j from it, a view is an inlier if ``d_j <= k * median(d)``.
The paper leaves the deviation open (docs/method.md#deviation):

- ``element``: |F_j - F~| in each channel separately, so each channel has its own inliers;
- ``cosine``: 1 - cos(F_j, F~), of histories alone;
- ``none``: every view is an inlier.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.arrays import Array, Bools, Ints32, Reals
from egosplat.language.vectors import unit

NORMS = ("element", "cosine", "none")

# The paper's k. Lower rejects more views, higher keeps views of the wrong object.
MAD_K = 3.0

# Block size: 2 MiB of float64 fit into a processor's cache.
_NUMBERS_AT_ONCE = 2**18


@dataclass(frozen=True)
class Aggregate:
    """Aggregation result for N instances with R views.

    Attributes:
        feature: (N, D) float64; 0 for an instance without views.
        views: (N,) int32 number of views.
        inlier: (R,) bool inliers in at least half of the channels.
    """

    feature: Array
    views: Ints32
    inlier: Bools


def aggregate(features: Reals, instance: NDArray[np.integer], count: int, norm: str, k: float) -> Aggregate:
    """Compute the consistent feature of each of ``count`` instances.

    Args:
        features, instance: (R, D) finite, and the (R,) instance of each row, sorted.
        norm, k: one of ``NORMS``; at least 1 (ValueError).
    """
    # With k >= 1, the view with the median deviation is an inlier: no mean is over nothing.
    if norm not in NORMS or not k >= 1:
        raise ValueError(f"norm {norm!r} must be one of {NORMS}, and k = {k} at least 1")
    found = Aggregate(
        np.zeros((count, features.shape[1])),
        np.bincount(instance, minlength=count).astype(np.int32),
        np.zeros(len(features), bool),
    )
    _, first, counts = np.unique(instance, return_index=True, return_counts=True)
    # Blocks of equal numbers of views, without padding: a tracked scene has many instances but few different numbers.
    for length in np.unique(counts):
        starts = first[counts == length]
        at_once = max(1, _NUMBERS_AT_ONCE // int(length * features.shape[1]))
        for begin in range(0, len(starts), at_once):
            rows = starts[begin : begin + at_once, None] + np.arange(length)
            owner = instance[rows[:, 0]]
            found.feature[owner], found.inlier[rows] = robust_mean(features[rows], norm, k)
    return found


def robust_mean(views: Reals, norm: str, k: float) -> tuple[Array, Bools]:
    """(G, D) float64 means of the inlier views of (G, V, D), and (G, V) bool inliers; see the module for norm and k."""
    values = views.astype(np.float64)
    if norm == "none":
        return values.mean(axis=1), np.ones(values.shape[:2], bool)
    if norm == "cosine":
        # 1 - cos = |u - v|^2 / 2, which is exactly 0 for equal vectors.
        distance = (
            np.linalg.norm(unit(values) - unit(median(values)[:, None]), axis=2, keepdims=True) ** 2 / 2
        )
        kept = distance <= k * median(distance)[:, None]
        return _mean(values, kept), kept[..., 0]
    kept = _kept_channels(values, k)
    # No single channel decides whether the view counts as an inlier; half of them do.
    return _mean(values, kept), 2 * kept.sum(axis=2) >= kept.shape[2]


def disagreement(views: Reals, norm: str, k: float) -> tuple[Array, float]:
    """What decides whether each view of one instance, (V, D) finite, is an inlier: (V,) float64, and the
    largest of an inlier: fraction of channels in which the view is an outlier, 0 for ``none``."""
    if norm == "none":
        return np.zeros(len(views)), 0.0
    return (~_kept_channels(views.astype(np.float64)[None], k)[0]).mean(axis=1), 0.5


def _kept_channels(values: Array, k: float) -> Bools:
    """(G, V, D) bool: inliers of each channel."""
    deviation = np.abs(values - median(values)[:, None])
    # The paper's MAD has no factor 1.4826, which would scale it to the standard deviation of a normal distribution.
    # <=, not <: one or two views have the deviations of their median, and identical views have 0. All of them stay.
    return deviation <= k * median(deviation)[:, None]


def median(values: Array) -> Array:
    """(G, V, D) -> (G, D) medians over V; for an even number, the mean of the two in the middle."""
    # Sorting contiguous numbers is several times as fast as a partition along the middle axis.
    ordered = np.sort(np.ascontiguousarray(values.transpose(0, 2, 1)), axis=2)
    count = ordered.shape[2]
    # Halved first: the sum of two large numbers may overflow.
    return ordered[..., (count - 1) // 2] / 2 + ordered[..., count // 2] / 2


def _mean(values: Array, kept: Bools) -> Array:
    """Average over axis 1 where ``kept``; at least one entry is kept."""
    number = np.maximum(kept.sum(axis=1), 1)
    # Divided before the sum, which cannot overflow then.
    return (np.where(kept, values, 0.0) / number[:, None]).sum(axis=1)

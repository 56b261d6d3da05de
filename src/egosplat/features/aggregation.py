"""Consistent features: the mean of an instance's views without those that disagree (paper, equations of the section
"View-Consistent Feature extraction"; docs/method.md#aggregation).

With views F_j, their channel-wise median Ft and their deviations d_j from it, a view counts where
``d_j <= k * median(d)``; there is no factor 1.4826. What d_j is, the paper leaves open (docs/method.md#deviation):

- ``element``: |F_j - Ft| in each channel by itself, so that each channel has its own views;
- ``euclidean``: the length of F_j - Ft;
- ``cosine``: 1 - cos(F_j, Ft);
- ``none``: every view counts.

What follows from the formula: one view, and two, are kept whole. Where more than half of the deviations are 0, all
others are left out. Of an even number the median is the mean of the two in the middle. With k of at least 1 never all
are left out. A majority of outliers decides as any majority does.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.codes.vectors import unit

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

NORMS = ("element", "euclidean", "cosine", "none")

_NUMBERS_AT_ONCE = 2**18
"""Of one block of views in float64: 2 MiB, which stay in a processor's cache."""


@dataclass(frozen=True)
class Aggregate:
    """What was aggregated of N instances with R views.

    Attributes:
        feature: (N, D) float64; 0 for an instance without views.
        views: (N,) int32 number of views.
        inlier: (R,) bool views that count; with the norm ``element`` those that count in at least half of the
            channels.
    """

    feature: Floats
    views: NDArray[np.int32]
    inlier: Bools


def aggregate(
    features: NDArray[np.floating], instance: NDArray[np.integer], count: int, norm: str, k: float
) -> Aggregate:
    """The consistent feature of each instance.

    Args:
        features: (R, D) finite.
        instance: (R,) instance of each row, sorted.
        count: N.
        norm: one of ``NORMS``.
        k: at least 1.

    Raises:
        ValueError: k is below 1, or the norm unknown.
    """
    if norm not in NORMS or not k >= 1:
        raise ValueError(f"norm {norm!r} is to be one of {NORMS}, k = {k} at least 1")
    found = Aggregate(
        np.zeros((count, features.shape[1])),
        np.bincount(instance, minlength=count).astype(np.int32),
        np.zeros(len(features), bool),
    )
    for rows in _of_equal_length(instance, features.shape[1]):
        owner = instance[rows[:, 0]]
        found.feature[owner], found.inlier[rows] = robust_mean(features[rows], norm, k)
    return found


def robust_mean(views: NDArray[np.floating], norm: str, k: float) -> tuple[Floats, Bools]:
    """The mean of the views that agree, for G instances of V views each; see the module for norm and k.

    Args:
        views: (G, V, D) finite.

    Returns:
        (G, D) float64 and (G, V) bool views that count.
    """
    values = views.astype(np.float64)
    if norm == "none":
        return values.mean(axis=1), np.ones(values.shape[:2], bool)
    if norm == "element":
        kept = _kept_channels(values, k)
        return _mean(values, kept), 2 * kept.sum(axis=2) >= kept.shape[2]
    distance, limit = _distances(values, norm, k)
    kept = distance <= limit[:, None]
    return _mean(values, kept[..., None]), kept


def disagreement(views: NDArray[np.floating], norm: str, k: float) -> tuple[Floats, float]:
    """The number by which it is decided whether each view of one instance counts, and the largest that counts.

    Args:
        views: (V, D) finite, one at least.

    Returns:
        (V,) float64: with the norm ``element`` the share of the channels in which the view does not count, with
        ``euclidean`` and ``cosine`` d_j of the module, with ``none`` 0; and the limit.
    """
    values = views.astype(np.float64)[None]
    if norm == "none":
        return np.zeros(len(views)), 0.0
    if norm == "element":
        return (~_kept_channels(values, k)[0]).mean(axis=1), 0.5
    distance, limit = _distances(values, norm, k)
    return distance[0], float(limit[0])


def _kept_channels(values: Floats, k: float) -> Bools:
    """(G, V, D) where each channel of each view counts."""
    deviation = np.abs(values - median(values)[:, None])
    return deviation <= k * median(deviation)[:, None]


def _distances(values: Floats, norm: str, k: float) -> tuple[Floats, Floats]:
    """(G, V) distances d_j of whole views, and (G,) the largest with which a view counts."""
    centre = median(values)[:, None]
    apart = values - centre if norm == "euclidean" else unit(values) - unit(centre)
    distance = np.linalg.norm(apart, axis=2)
    if norm == "cosine":
        # 1 - cos = |u - v|^2 / 2, which is exactly 0 for equal vectors.
        distance = distance**2 / 2
    return distance, k * median(distance[..., None])[:, 0]


def median(values: Floats) -> Floats:
    """(G, V, D) -> (G, D) medians over V; of an even number the mean of the two in the middle."""
    # Sorting contiguous numbers is several times as fast as a partition across the middle axis.
    ordered = np.sort(np.ascontiguousarray(values.transpose(0, 2, 1)), axis=2)
    count = ordered.shape[2]
    # Halved first: the sum of two large numbers may overflow.
    return ordered[..., (count - 1) // 2] / 2 + ordered[..., count // 2] / 2


def _mean(values: Floats, kept: Bools) -> Floats:
    """Mean over axis 1 of what is kept, at least one of which there is."""
    number = np.maximum(kept.sum(axis=1), 1)
    return (np.where(kept, values, 0.0) / number[:, None]).sum(axis=1)


def _of_equal_length(instance: NDArray[np.integer], channels: int) -> Iterator[NDArray[np.int64]]:
    """(G, V) rows of instances that have equally many views, few enough at a time.

    Blocks without padding: a tracked scene has many instances, but few different numbers of views.
    """
    _, first, counts = np.unique(instance, return_index=True, return_counts=True)
    for count in np.unique(counts):
        starts = first[counts == count]
        at_once = max(1, _NUMBERS_AT_ONCE // int(count * channels))
        for begin in range(0, len(starts), at_once):
            yield starts[begin : begin + at_once, None] + np.arange(count)

"""Levels that repeat another: all that such a level shows is an instance of the other too."""

import numpy as np
from numpy.typing import NDArray

from egosplat.segments.label_maps import LabelMaps

SAME_IOU = 0.8
"""Instances of two levels whose pixels overlap more, over all frames, are one thing."""

REPEATED = 0.95
"""A level repeats another where so many of its instances are the other's."""


def find_duplicate_levels(
    labels: LabelMaps, table: NDArray[np.int32], level: NDArray[np.int8], count: int
) -> dict[int, int]:
    """Which level repeats which that stays; of two that are alike the finer one repeats.

    Args:
        labels: of all frames, by old numbers; table: their new ones, see ``instances.FinalInstances``.
        level: (N,) of each instance that stays.
        count: of levels. One without an instance repeats none.
    """
    iou = _overlaps(labels, table, len(level))
    found: dict[int, int] = {}
    for finer in range(count):
        for other in sorted({*range(count)} - {finer, *found}):
            of_both = iou[np.ix_(level == finer, level == other)]
            if of_both.size and (of_both.max(axis=1) > SAME_IOU).mean() >= REPEATED:
                found[finer] = other
                break
    return {one: _last(found, other) for one, other in found.items()}


def _last(repeated: dict[int, int], level: int) -> int:
    """The level that stays, of one that repeats another that may repeat another."""
    while level in repeated:
        level = repeated[level]
    return level


def drop_levels(
    repeated: dict[int, int], table: NDArray[np.int32], level: NDArray[np.int8]
) -> NDArray[np.int32]:
    """The table of new numbers without the instances of levels that repeat another; the others close up."""
    stays = ~np.isin(level, list(repeated))
    closed = np.where(stays, np.cumsum(stays) - 1, -1)
    return np.append(closed, -1).astype(np.int32)[table]


def _overlaps(labels: LabelMaps, table: NDArray[np.int32], count: int) -> NDArray[np.float64]:
    """(N, N) IoU of the instances' pixels, all frames together; 0 within a level, whose instances share none."""
    area, shared = np.zeros(count), np.zeros((count + 1, count + 1))
    for frame in range(len(labels)):
        maps = table[labels[frame]] + 1
        flat = maps.reshape(len(maps), -1)
        for place, one in enumerate(flat):
            area += np.bincount(one, minlength=count + 1)[1:]
            for another in flat[place + 1 :]:
                pairs = np.bincount(one * (count + 1) + another, minlength=(count + 1) ** 2)
                shared += pairs.reshape(count + 1, count + 1)
    both = (shared + shared.T)[1:, 1:]
    union = area[:, None] + area[None] - both
    return np.divide(both, union, out=np.zeros_like(both), where=union > 0)

"""Find levels that repeat another level, and drop their instances."""

import numpy as np
from numpy.typing import NDArray

from egosplat.segments.label_maps import LabelMaps

# Two instances of different levels are the same object if their IoU over all frames is larger.
SAME_IOU = 0.8

# A level repeats another if at least this share of its instances are the same objects as the other's.
REPEATED = 0.95


def find_duplicate_levels(
    labels: LabelMaps, table: NDArray[np.int32], level: NDArray[np.int8], count: int
) -> dict[int, int]:
    """Map each level that repeats another to the level that is kept. Of two equal levels the finer one is dropped.

    Args:
        labels: old instance numbers of all frames.
        table: new number of each old one, see ``instances.FinalInstances``.
        level: (N,) level of each instance that is kept.
        count: number of levels. A level without instances repeats none.
    """
    iou = _overlaps(labels, table, len(level))
    found: dict[int, int] = {}
    # From fine to coarse, so that the finer of two equal levels is dropped.
    for finer in range(count):
        for other in sorted({*range(count)} - {finer, *found}):
            of_both = iou[np.ix_(level == finer, level == other)]
            if of_both.size and (of_both.max(axis=1) > SAME_IOU).mean() >= REPEATED:
                found[finer] = other
                break
    return {one: _last(found, other) for one, other in found.items()}


def _last(repeated: dict[int, int], level: int) -> int:
    """Follow a chain of repeated levels to the level that is kept."""
    while level in repeated:
        level = repeated[level]
    return level


def drop_levels(
    repeated: dict[int, int], table: NDArray[np.int32], level: NDArray[np.int8]
) -> NDArray[np.int32]:
    """Remove the instances of repeated levels from the table of new numbers; the remaining numbers have no gaps."""
    stays = ~np.isin(level, list(repeated))
    closed = np.where(stays, np.cumsum(stays) - 1, -1)
    return np.append(closed, -1).astype(np.int32)[table]


def _overlaps(labels: LabelMaps, table: NDArray[np.int32], count: int) -> NDArray[np.float64]:
    """(N, N) IoU of the instances' pixels over all frames; 0 within a level, where instances do not overlap."""
    area, shared = np.zeros(count), np.zeros((count + 1, count + 1))
    for frame in range(len(labels)):
        maps = table[labels[frame]] + 1  # 0 is no instance
        flat = maps.reshape(len(maps), -1)
        for place, one in enumerate(flat):
            area += np.bincount(one, minlength=count + 1)[1:]
            for another in flat[place + 1 :]:
                pairs = np.bincount(one * (count + 1) + another, minlength=(count + 1) ** 2)
                shared += pairs.reshape(count + 1, count + 1)
    both = (shared + shared.T)[1:, 1:]
    union = area[:, None] + area[None] - both
    return np.divide(both, union, out=np.zeros_like(both), where=union > 0)

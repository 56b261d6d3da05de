"""Scores of a segmented video: coverage, IoU over time, identity switches, fragments."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Labels = NDArray[np.int32]

# Of the picture, that a true instance covers in a frame to count there.
LEAST_SHARE = 0.001

# In which a true instance counts to be judged at all.
LEAST_FRAMES = 3

# Share of a true instance's pixels that one found instance holds, to stand for it in a frame.
_DOMINATES = 0.5


@dataclass(frozen=True)
class VideoScores:
    """Means over the true instances of one level.

    Attributes:
        instances: how many true ones are judged; found: how many there are in the segmentation.
        coverage: share of the valid pixels with a label.
        iou: of each true instance with the found one that fits it best, both over all frames.
        switches: changes of the found instance that stands for a true one, between frames where one does.
        fragments: found instances that stand for a true one at some time; 0 for one that none ever stands for.
        held: share of the frames in which any found instance stands for a true one.
    """

    instances: int
    found: int
    coverage: float
    iou: float
    switches: float
    fragments: float
    held: float


def score_level(pairs: Iterable[tuple[Labels, Labels]]) -> VideoScores:
    """Compare frame by frame.

    Args:
        pairs: (H, W) true and found labels of each frame, -1 for none; true labels of -1 are not valid pixels.
    """
    overlaps: list[NDArray[np.int64]] = []
    for true, found in pairs:
        overlaps.append(_overlap(true, found))
    true_count = max((overlap.shape[0] for overlap in overlaps), default=1)
    found_count = max((overlap.shape[1] for overlap in overlaps), default=1)
    table = np.zeros((len(overlaps), true_count, found_count), dtype=np.int64)
    for frame, overlap in enumerate(overlaps):
        table[frame, : overlap.shape[0], : overlap.shape[1]] = overlap
    return _summary(table)


def _overlap(true: Labels, found: Labels) -> NDArray[np.int64]:
    """(true + 1, found + 1) pixels of each pair; row and column 0 stand for no label."""
    rows, columns = int(true.max()) + 2, int(found.max()) + 2
    pairs = (true.astype(np.int64) + 1) * columns + found + 1
    return np.bincount(pairs.ravel(), minlength=rows * columns).reshape(rows, columns)


def _summary(table: NDArray[np.int64]) -> VideoScores:
    """Of (F, true + 1, found + 1) overlaps."""
    valid = table[:, 1:]
    area = valid.sum(axis=2)
    picture = table.sum(axis=(1, 2))
    counts = area >= LEAST_SHARE * picture[:, None]
    judged = np.flatnonzero(counts.sum(axis=0) >= LEAST_FRAMES)
    shared = valid[:, :, 1:].sum(axis=0)
    union = valid.sum(axis=(0, 2))[:, None] + table[:, :, 1:].sum(axis=(0, 1))[None] - shared
    iou = np.divide(shared, union, out=np.zeros(shared.shape), where=union > 0)
    best = iou.max(axis=1, initial=0.0)
    switches, fragments, held = zip(
        *(_history(valid[:, one, 1:], area[:, one], counts[:, one]) for one in judged), strict=True
    )
    return VideoScores(
        len(judged),
        int((table[:, :, 1:].sum(axis=(0, 1)) > 0).sum()),
        float(valid[:, :, 1:].sum() / max(1, valid.sum())),
        float(best[judged].mean()),
        float(np.mean(switches)),
        float(np.mean(fragments)),
        float(np.mean(held)),
    )


def _history(
    shared: NDArray[np.int64], area: NDArray[np.int64], counts: NDArray[np.bool_]
) -> tuple[int, int, float]:
    """Switches, fragments and share of frames held of one true instance: (F, found) pixels and (F,) area."""
    if shared.shape[1] == 0:
        return 0, 0, 0.0
    strongest = shared.argmax(axis=1)
    stands = counts & (shared.max(axis=1) >= _DOMINATES * area)
    names = strongest[stands]
    return int((np.diff(names) != 0).sum()), len(np.unique(names)), float(stands.sum() / max(1, counts.sum()))

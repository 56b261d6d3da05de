"""The instances of a video: what began each of them, and their label maps."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.segments.label_maps import LabelMaps
from egosplat.segments.merging import kept, merged


@dataclass(frozen=True)
class Instance:
    """What began an instance.

    Attributes:
        level: index into ``options.LEVELS``; first_frame: whose prompts found it.
        predicted_iou, stability: of the mask that began it.
    """

    level: int
    first_frame: int
    predicted_iou: float
    stability: float


@dataclass(frozen=True)
class Segmented:
    """A segmented video, before duplicates and fragments are dealt with.

    Attributes:
        labels: number of the instance at each pixel, by frame and level.
        instances: by their number.
        same: pairs of numbers that are one thing.
        notes: what is worth keeping of how it went; plain JSON values.
    """

    labels: LabelMaps
    instances: list[Instance]
    same: list[tuple[int, int]]
    notes: dict[str, object]


@dataclass(frozen=True)
class Settled:
    """What stays of a segmented video, and under which number.

    Attributes:
        table: (count + 1,) int32 new number of each instance, -1 of those that are dropped; the last entry is the
            one that -1 picks: nothing stays nothing.
        staying: (N,) old numbers of those that stay, in their new order.
        merged: how many were the same as others.
    """

    table: NDArray[np.int32]
    staying: NDArray[np.int64]
    merged: int


def settle(segmented: Segmented, min_frames: int) -> Settled:
    """Merge what is one thing and drop what is seen in too few frames, see ``merging``."""
    roots = merged(len(segmented.instances), segmented.same)
    seen = frames_seen(segmented.labels, roots)
    new, staying = kept(roots, seen, min_frames, len(segmented.labels))
    return Settled(np.append(new, -1).astype(np.int32), staying, int((roots != np.arange(len(roots))).sum()))


def frames_seen(labels: LabelMaps, roots: NDArray[np.int64]) -> NDArray[np.int64]:
    """(count,) in how many frames each root, from ``merging.merged``, is seen at any pixel."""
    seen = np.zeros(len(roots), dtype=np.int64)
    for frame in range(len(labels)):
        found = np.unique(labels[frame])
        seen[np.unique(roots[found[found >= 0]])] += 1
    return seen

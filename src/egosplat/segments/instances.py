"""The instances of a video: what began each of them, and their label maps."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.segments.labels import LabelMaps


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


def frames_seen(labels: LabelMaps, roots: NDArray[np.int64]) -> NDArray[np.int64]:
    """(count,) in how many frames each root, from ``merging.merged``, is seen at any pixel."""
    seen = np.zeros(len(roots), dtype=np.int64)
    for frame in range(len(labels)):
        found = np.unique(labels[frame])
        seen[np.unique(roots[found[found >= 0]])] += 1
    return seen

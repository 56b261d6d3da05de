"""The classical segmenter over a whole video."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from egosplat.progress import track as progress
from egosplat.segments.classical.segmenter import LEVELS, ClassicalOptions, track_levels
from egosplat.segments.instances import Instance, Segmented
from egosplat.segments.label_maps import LabelMaps


def segment_video(
    pictures: Callable[[int], NDArray[np.uint8]], frames: int, valid: NDArray[np.bool_]
) -> Segmented:
    """Regions of each level, followed by optical flow; a region's track is an instance.

    Args:
        pictures: (H, W, 3) uint8 RGB of a frame, by its index; frames: how many; valid: (H, W) bool.
    """
    labels = LabelMaps((len(LEVELS), *valid.shape))
    instances: list[Instance] = []
    tracked = track_levels(map(pictures, range(frames)), valid, ClassicalOptions())
    known: list[dict[int, int]] = [{} for _ in LEVELS]
    for frame, levels in enumerate(progress(tracked, "following regions", total=frames)):
        maps = []
        for level, regions in enumerate(levels):
            for number in np.unique(regions[regions >= 0]).tolist():
                if number not in known[level]:
                    known[level][number] = len(instances)
                    instances.append(Instance(level, frame, 1.0, 1.0))
            maps.append(_renumbered(regions, known[level]))
        labels[frame] = np.stack(maps)
    return Segmented(labels, instances, [], {})


def _renumbered(regions: NDArray[np.int32], numbers: dict[int, int]) -> NDArray[np.int32]:
    """Track numbers of a level as instance numbers."""
    table = np.full(int(regions.max(initial=-1)) + 2, -1, dtype=np.int32)
    for track_number, instance in numbers.items():
        if track_number < len(table) - 1:
            table[track_number] = instance
    return table[regions]

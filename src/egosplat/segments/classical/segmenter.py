"""The classical segmenter: graph segmentation, region merging, and optical flow, without learned weights.

It is the baseline for SAM2, and an alternative for recordings unlike SAM2's training data.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from egosplat.progress import track as progress
from egosplat.segments.classical.mask_propagation import propagate_masks
from egosplat.segments.classical.options import ClassicalOptions
from egosplat.segments.classical.partition import partition
from egosplat.segments.classical.tracking import propagate, track, track_levels
from egosplat.segments.instances import Segmented, Track
from egosplat.segments.label_maps import LabelMaps
from egosplat.segments.options import LEVELS

__all__ = [
    "LEVELS",
    "ClassicalOptions",
    "propagate",
    "propagate_masks",
    "segment",
    "segment_video",
    "track",
    "track_levels",
]


def segment(
    image: NDArray[np.uint8], valid: NDArray[np.bool_], options: ClassicalOptions
) -> NDArray[np.int32]:
    """Segment an image into nested regions.

    Args:
        image: (H, W, 3) uint8 RGB.
        valid: (H, W) bool; pixels outside have no influence.
        options: see ``ClassicalOptions``.

    Returns:
        (3, H, W) int32 regions of the levels subpart, part and whole, numbered from 0 at each level, -1 outside
        of ``valid``. A region is a union of regions of the next finer level.

    Raises:
        ValueError: wrong shape or element type.
    """
    return partition(image, valid, options)[1:]


def segment_video(
    images: Callable[[int], NDArray[np.uint8]], frames: int, valid: NDArray[np.bool_]
) -> Segmented:
    """Segment a video: regions of each level, tracked by optical flow. A region's track is an instance.

    Args:
        images: returns the (H, W, 3) uint8 RGB image of a frame index.
        frames: number of frames.
        valid: (H, W) bool, pixels that show the scene.
    """
    labels = LabelMaps((len(LEVELS), *valid.shape))
    instances: list[Track] = []
    tracked = track_levels(map(images, range(frames)), valid, ClassicalOptions())
    known: list[dict[int, int]] = [{} for _ in LEVELS]
    for frame, levels in enumerate(progress(tracked, "tracking regions", total=frames)):
        maps = []
        for level, regions in enumerate(levels):
            for number in np.unique(regions[regions >= 0]).tolist():
                if number not in known[level]:
                    known[level][number] = len(instances)
                    instances.append(Track(level, frame, 1.0, 1.0))
            maps.append(_to_instance_numbers(regions, known[level]))
        labels[frame] = np.stack(maps)
    return Segmented(labels, instances, [], {})


def _to_instance_numbers(regions: NDArray[np.int32], numbers: dict[int, int]) -> NDArray[np.int32]:
    """Map the track numbers of a level to instance numbers."""
    table = np.full(int(regions.max(initial=-1)) + 2, -1, dtype=np.int32)
    for track_number, instance in numbers.items():
        if track_number < len(table) - 1:
            table[track_number] = instance
    return table[regions]

"""The classical segmenter: graph segmentation, region merging, and optical flow, without learned weights.

It is the baseline for SAM2, and an alternative for recordings unlike SAM2's training data.
"""

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from egosplat.progress import track as progress
from egosplat.segments.classical.flow import find_origins
from egosplat.segments.classical.options import ClassicalOptions
from egosplat.segments.classical.partition import partition
from egosplat.segments.classical.tracking import propagate, track, track_levels
from egosplat.segments.classical.working_image import check_map
from egosplat.segments.instances import Segmented, Track
from egosplat.segments.label_maps import LabelMaps
from egosplat.segments.options import LEVELS

Masks = NDArray[np.bool_]


def propagate_masks(
    masks: Masks, images: Iterable[NDArray[np.uint8]], valid: NDArray[np.bool_], options: ClassicalOptions
) -> Iterator[Masks]:
    """Propagate masks, which may overlap, by optical flow, and fit them to the fine regions of each frame.

    A fine region joins a mask if most of its pixels come from the mask, and leaves it if few do; otherwise each
    pixel decides for itself. Two frames are held in memory.

    Args:
        masks: (K, H, W) bool of the first image.
        images: (H, W, 3) uint8 RGB each.
        valid: (H, W) bool, of all images.

    Yields:
        (K, H, W) bool for each image; for the first, ``masks`` within ``valid``.

    Raises:
        ValueError: wrong shape or element type.
    """
    if masks.ndim != 3:
        raise ValueError(f"masks are (K, H, W) bool, not {masks.shape} {masks.dtype}")
    check_map(masks, np.dtype(bool), (len(masks), *valid.shape), "masks")
    check_map(valid, np.dtype(bool), masks.shape[1:], "valid")
    return _propagate(masks & valid, images, valid, options)


def _propagate(
    masks: Masks, images: Iterable[NDArray[np.uint8]], valid: NDArray[np.bool_], options: ClassicalOptions
) -> Iterator[Masks]:
    previous = None
    for image in images:
        regions = partition(image, valid, options)[0]
        if previous is not None:
            origins = find_origins(previous, image, valid, options)
            brought = origins.look_up(masks) & origins.known
            masks = np.zeros_like(masks)
            for mask, one in zip(masks, brought, strict=True):
                mask[:] = snap(one, origins.known, regions, options)
        previous = image
        yield masks


def snap(mask: Masks, known: Masks, regions: NDArray[np.int32], options: ClassicalOptions) -> Masks:
    """Fit a mask to regions.

    Args:
        mask: (H, W) bool.
        known: (H, W) bool, where the mask is defined.
        regions: (H, W) int32, -1 outside of the valid pixels.
        options: ``least_support`` and ``purity`` are used.

    Returns:
        (H, W) bool.
    """
    count = int(regions.max(initial=-1)) + 1
    size = np.bincount(regions[regions >= 0], minlength=count)
    voters = np.bincount(regions[known & (regions >= 0)], minlength=count)
    yes = np.bincount(regions[mask & known & (regions >= 0)], minlength=count)
    decided = (voters > 0) & (voters >= options.least_support * size)
    # Index -1, a pixel without a region, selects the last entry.
    taken = np.append(decided & (yes >= options.purity * voters), False)
    left = np.append(decided & (voters - yes >= options.purity * voters), True)
    return taken[regions] | (mask & known & ~left[regions])


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

"""Propagate given masks from frame to frame by optical flow."""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from egosplat.segments.classical.flow import find_origins
from egosplat.segments.classical.options import ClassicalOptions
from egosplat.segments.classical.partition import partition
from egosplat.segments.classical.working_image import check_map

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
        options: see ``ClassicalOptions``.

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

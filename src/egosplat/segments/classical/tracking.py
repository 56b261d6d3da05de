"""Track regions from frame to frame by optical flow."""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from egosplat.segments.classical.flow import Origins, find_origins
from egosplat.segments.classical.options import ClassicalOptions
from egosplat.segments.classical.partition import partition
from egosplat.segments.classical.working_image import check_image, check_map
from egosplat.segments.options import LEVELS

Labels = NDArray[np.int32]


def propagate(
    labels: Labels,
    previous: NDArray[np.uint8],
    current: NDArray[np.uint8],
    regions: Labels,
    options: ClassicalOptions,
) -> Labels:
    """Propagate labels to the next frame.

    Optical flow gives each pixel the label of its origin; a fine region takes the label of most of its pixels.
    A pixel that was hidden, out of view or without a label has no vote.

    Args:
        labels: (H, W) int32 of the previous frame, -1 for none.
        previous, current: (H, W, 3) uint8 RGB.
        regions: (H, W) int32 fine regions of the current frame, -1 outside of the valid pixels (of both frames).

    Returns:
        (H, W) int32 labels of the current frame, -1 for none.

    Raises:
        ValueError: wrong shape or element type.
    """
    valid = regions >= 0
    check_image(previous, valid)
    check_image(current, valid)
    check_map(regions, np.dtype(np.int32), valid.shape, "regions")
    check_map(labels, np.dtype(np.int32), valid.shape, "labels")
    return _propagate_along(labels, find_origins(previous, current, valid, options), regions, options)


def _propagate_along(labels: Labels, origins: Origins, regions: Labels, options: ClassicalOptions) -> Labels:
    """``propagate`` with the origins of the pixels given."""
    brought = np.where(origins.known, origins.look_up(labels), np.int32(-1))
    return _vote(brought, regions, options)


def _vote(brought: Labels, regions: Labels, options: ClassicalOptions) -> Labels:
    """Give each region the label that wins the vote; without a winner its pixels keep their own labels."""
    has_label = brought >= 0
    if not has_label.any():
        return np.full_like(brought, -1)
    count, kinds = int(regions.max()) + 1, np.int64(brought.max()) + 1
    cells, votes = np.unique(regions[has_label] * kinds + brought[has_label], return_counts=True)
    region, label = np.divmod(cells, kinds)
    # The last assignment wins: most votes, then the smallest label.
    order = np.lexsort((-label, votes))
    winner, most = np.full(count, -1, dtype=np.int32), np.zeros(count)
    winner[region[order]], most[region[order]] = label[order], votes[order]
    voters = np.bincount(region, votes, count)
    size = np.bincount(regions[regions >= 0], minlength=count)
    won = (voters >= options.least_support * size) & (most >= options.purity * voters) & (voters > 0)
    inside = np.maximum(regions, 0)
    return np.where(won[inside] & (regions >= 0), winner[inside], brought)


def track(
    images: Iterable[NDArray[np.uint8]], valid: NDArray[np.bool_], level: str, options: ClassicalOptions
) -> Iterator[Labels]:
    """Track the regions of a level; a region that comes into view starts a new track. Holds two frames in memory.

    Args:
        images: (H, W, 3) uint8 RGB each.
        valid: (H, W) bool, of all images.
        level: one of ``LEVELS``.

    Yields:
        (H, W) int32 track number of each pixel, -1 for none. The first frame's numbers are those of its regions;
        no number is used twice.

    Raises:
        ValueError: unknown level; wrong shape or element type.
    """
    if level not in LEVELS:
        raise ValueError(f"level {level!r} is none of {', '.join(LEVELS)}")
    # A generator function would check its arguments only when the first frame is requested.
    return (labels[0] for labels in _track(images, valid, (LEVELS.index(level) + 1,), options))


def track_levels(
    images: Iterable[NDArray[np.uint8]], valid: NDArray[np.bool_], options: ClassicalOptions
) -> Iterator[list[Labels]]:
    """``track`` all ``LEVELS`` at once: each image is segmented, and its flow computed, once."""
    return _track(images, valid, tuple(range(1, len(LEVELS) + 1)), options)


def _track(
    images: Iterable[NDArray[np.uint8]],
    valid: NDArray[np.bool_],
    levels: tuple[int, ...],
    options: ClassicalOptions,
) -> Iterator[list[Labels]]:
    """Track some of the levels that ``partition`` returns."""
    previous = None
    labels = [np.full(valid.shape, -1, dtype=np.int32) for _ in levels]
    tracks = [0] * len(levels)
    for image in images:
        found = partition(image, valid, options)
        if previous is not None:
            origins = find_origins(previous, image, valid, options)
            labels = [_propagate_along(one, origins, found[0], options) for one in labels]
        # In the first frame every region becomes a track, however small.
        least = options.new_area * valid.sum() if previous is not None else 1
        for number, level in enumerate(levels):
            labels[number] = open_tracks(labels[number], found[level], tracks[number], least)
            tracks[number] = max(tracks[number], int(labels[number].max(initial=-1)) + 1)
        previous = image
        yield list(labels)


def open_tracks(labels: Labels, regions: Labels, first: int, least_pixels: float) -> Labels:
    """Start tracks for regions that no track covers.

    Args:
        labels: (H, W) int32, -1 where no track covers the pixel.
        regions: (H, W) int32, -1 outside of the valid pixels.
        first: number of the next new track.
        least_pixels: number of uncovered pixels a region needs to become a track.

    Returns:
        (H, W) int32 labels.
    """
    uncovered = (labels < 0) & (regions >= 0)
    count = int(regions.max(initial=-1)) + 1
    large = np.flatnonzero(np.bincount(regions[uncovered], minlength=count) >= max(1, least_pixels))
    numbers = np.full(count + 1, -1, dtype=np.int32)
    numbers[large] = first + np.arange(len(large))
    return np.where(uncovered, numbers[regions], labels)

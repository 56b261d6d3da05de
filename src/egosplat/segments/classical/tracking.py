"""Regions followed from frame to frame."""

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
    """Carry labels on to the next frame.

    Each pixel looks up its label where optical flow says that it was; a fine region takes the label that most of
    its pixels bring. A pixel that was hidden, out of view or without a label brings none.

    Args:
        labels: (H, W) int32 of the previous frame, -1 for none.
        previous, current: (H, W, 3) uint8 RGB.
        regions: (H, W) int32 fine regions of the current frame, -1 outside of the valid pixels (of both frames).
        options: see ``ClassicalOptions``.

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
    """``propagate``, where it is known already where pixels come from."""
    brought = np.where(origins.known, origins.look_up(labels), np.int32(-1))
    return _vote(brought, regions, options)


def _vote(brought: Labels, regions: Labels, options: ClassicalOptions) -> Labels:
    """Give each region the label that wins in it, or where none does leave its pixels those they bring."""
    has_label = brought >= 0
    if not has_label.any():
        return np.full_like(brought, -1)
    count, kinds = int(regions.max()) + 1, np.int64(brought.max()) + 1
    cells, votes = np.unique(regions[has_label] * kinds + brought[has_label], return_counts=True)
    region, label = np.divmod(cells, kinds)
    # Of equal votes the smaller label wins: sorted last are the most votes, then the smallest label.
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
    """Follow the regions of a level; what comes into view becomes a new track. Holds two frames at a time.

    Args:
        images: (H, W, 3) uint8 RGB each.
        valid: (H, W) bool, of all images.
        level: one of ``LEVELS``.
        options: see ``ClassicalOptions``.

    Yields:
        (H, W) int32 number of the track that each pixel belongs to, -1 for none; the numbers of the first frame
        are those of its regions, and a number is never given twice.

    Raises:
        ValueError: unknown level; wrong shape or element type.
    """
    if level not in LEVELS:
        raise ValueError(f"level {level!r} is none of {', '.join(LEVELS)}")
    # A function that yields checks nothing before its first frame is asked for: hence the second one.
    return (labels[0] for labels in _track(images, valid, (LEVELS.index(level) + 1,), options))


def track_levels(
    images: Iterable[NDArray[np.uint8]], valid: NDArray[np.bool_], options: ClassicalOptions
) -> Iterator[list[Labels]]:
    """``track`` of all ``LEVELS`` at once: each image is cut, and its flow computed, once."""
    return _track(images, valid, tuple(range(1, len(LEVELS) + 1)), options)


def _track(
    images: Iterable[NDArray[np.uint8]],
    valid: NDArray[np.bool_],
    levels: tuple[int, ...],
    options: ClassicalOptions,
) -> Iterator[list[Labels]]:
    """Labels of some of the levels that ``partition`` gives."""
    previous = None
    labels = [np.full(valid.shape, -1, dtype=np.int32) for _ in levels]
    tracks = [0] * len(levels)
    for image in images:
        found = partition(image, valid, options)
        if previous is not None:
            origins = find_origins(previous, image, valid, options)
            labels = [_propagate_along(one, origins, found[0], options) for one in labels]
        # In the first frame all is uncovered, and everything however small is given a track.
        least = options.new_area * valid.sum() if previous is not None else 1
        for number, level in enumerate(levels):
            labels[number] = open_tracks(labels[number], found[level], tracks[number], least)
            tracks[number] = max(tracks[number], int(labels[number].max(initial=-1)) + 1)
        previous = image
        yield list(labels)


def open_tracks(labels: Labels, regions: Labels, first: int, least_pixels: float) -> Labels:
    """Number what no track covers.

    Args:
        labels: (H, W) int32, -1 where nothing is covered.
        regions: (H, W) int32, -1 outside of the valid pixels.
        first: number of the next new track.
        least_pixels: of a region must be uncovered for it to become a track.

    Returns:
        (H, W) int32 labels.
    """
    uncovered = (labels < 0) & (regions >= 0)
    count = int(regions.max(initial=-1)) + 1
    large = np.flatnonzero(np.bincount(regions[uncovered], minlength=count) >= max(1, least_pixels))
    numbers = np.full(count + 1, -1, dtype=np.int32)
    numbers[large] = first + np.arange(len(large))
    return np.where(uncovered, numbers[regions], labels)

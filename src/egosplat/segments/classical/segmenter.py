"""The classical segmenter: graph segmentation, region merging, and optical flow, without learned weights.

It is the baseline for SAM2, and an alternative for recordings unlike SAM2's training data.
"""

from collections.abc import Callable, Iterable, Iterator
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from egosplat.progress import track as progress
from egosplat.segments.classical.flow import Origins, find_origins
from egosplat.segments.classical.options import ClassicalOptions
from egosplat.segments.classical.partition import partition
from egosplat.segments.instances import Segmented, Track
from egosplat.segments.label_maps import LabelMaps
from egosplat.segments.options import LEVELS

Labels = NDArray[np.int32]


def segment_video(
    images: Callable[[int], NDArray[np.uint8]],
    frames: int,
    valid: NDArray[np.bool_],
    shown: Callable[[int], NDArray[np.bool_]] | None = None,
) -> Segmented:
    """Segment a video: regions of each level, tracked by optical flow, as instances; arguments as of ``Tracker``."""
    labels = LabelMaps((len(LEVELS), *valid.shape))
    instances: list[Track] = []
    inside = map(shown, range(frames)) if shown else None
    tracked = track_levels(map(images, range(frames)), valid, ClassicalOptions(), inside)
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


def track_levels(
    images: Iterable[NDArray[np.uint8]],
    valid: NDArray[np.bool_],
    options: ClassicalOptions,
    shown: Iterable[NDArray[np.bool_]] | None = None,
) -> Iterator[list[Labels]]:
    """Track the regions of all ``LEVELS``; a region that comes into view starts a new track. Holds two frames in memory.

    Args:
        images: (H, W, 3) uint8 RGB each.
        valid: (H, W) bool, of all images.
        shown: (H, W) bool of each image, which then takes the place of ``valid``.

    Yields:
        For each level, (H, W) int32 track number of each pixel, -1 for none. The first frame's numbers are those of its
        regions; no number is used twice.
    """
    previous, before = None, valid
    labels = [np.full(valid.shape, -1, dtype=np.int32) for _ in LEVELS]
    tracks = [0] * len(LEVELS)
    for image, inside in zip(images, repeat(valid) if shown is None else shown, strict=False):
        fine, *levels = partition(image, inside, options)
        if previous is not None and before.any() and inside.any():
            origins = find_origins(previous, image, inside, options, before)
            labels = [propagate(one, origins, fine, options) for one in labels]
        else:
            labels = [np.full_like(one, -1) for one in labels]
        # In the first frame every region becomes a track, however small.
        least = options.new_area * inside.sum() if previous is not None else 1
        for number, regions in enumerate(levels):
            labels[number] = open_tracks(labels[number], regions, tracks[number], least)
            tracks[number] = max(tracks[number], int(labels[number].max(initial=-1)) + 1)
        previous, before = image, inside
        yield list(labels)


def propagate(labels: Labels, origins: Origins, regions: Labels, options: ClassicalOptions) -> Labels:
    """Propagate (H, W) int32 labels, -1 for none, to the next frame: a fine region takes the label of most of its pixels.

    A pixel that was hidden, out of view or without a label has no vote.

    Args:
        origins: of the current frame's pixels in the previous frame.
        regions: (H, W) int32 fine regions of the current frame, -1 outside of the valid pixels (of both frames).
    """
    return _vote(np.where(origins.known, origins.look_up(labels), np.int32(-1)), regions, options)


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


def open_tracks(labels: Labels, regions: Labels, first: int, least_pixels: float) -> Labels:
    """Start tracks, numbered from ``first``, for (H, W) regions of which no track covers ``least_pixels`` or more pixels.

    Labels and regions are (H, W) int32, -1 for none; so is what is returned.
    """
    uncovered = (labels < 0) & (regions >= 0)
    count = int(regions.max(initial=-1)) + 1
    large = np.flatnonzero(np.bincount(regions[uncovered], minlength=count) >= max(1, least_pixels))
    numbers = np.full(count + 1, -1, dtype=np.int32)
    numbers[large] = first + np.arange(len(large))
    return np.where(uncovered, numbers[regions], labels)

"""The classical segmenter: graph segmentation, region merging, and optical flow, without learned weights.

It is the baseline for SAM2, and an alternative for recordings unlike SAM2's training data.
"""

import numpy as np
from numpy.typing import NDArray

from egosplat.progress import track as progress
from egosplat.segments.classical.flow import find_origins
from egosplat.segments.classical.partition import Bools, Labels, WorkingImage, partition, reduce_image
from egosplat.segments.instances import Segmented, Track, Video
from egosplat.segments.label_maps import LabelMaps
from egosplat.segments.options import LEVELS

# A region takes a label only if this share of its pixels has one, and if this share of those agrees; else its pixels
# keep their own labels.
LEAST_SUPPORT, PURITY = 0.15, 0.7
# An uncovered region becomes a new track if it has at least this share of the valid pixels.
_NEW_AREA = 1e-3


def segment_video(video: Video) -> Segmented:
    """Segment a video: the regions of each level, tracked by optical flow, as instances. Holds two frames in memory."""
    current = [np.full(video.shown(0).shape, -1, np.int32) for _ in LEVELS]
    labels, instances = LabelMaps((len(LEVELS), *current[0].shape)), []
    previous: WorkingImage | None = None
    for frame in progress(range(video.length), "tracking regions"):
        image = reduce_image(video.image(frame), video.shown(frame))
        fine, *levels = partition(image)
        origins = None
        if previous is not None and previous.shown.any() and image.shown.any():
            origins = find_origins(previous, image)
        # In the first frame every region becomes a track, however small.
        least = 1 if previous is None else _NEW_AREA * image.shown.sum()
        for level, regions in enumerate(levels):
            brought = np.full_like(fine, -1) if origins is None else propagate(current[level], *origins, fine)
            first = len(instances)
            current[level] = open_tracks(brought, regions, first, least)
            instances += [Track(level, frame, 1.0, 1.0)] * (int(current[level].max(initial=-1)) + 1 - first)
        labels[frame], previous = np.stack(current), image
    return Segmented(labels, instances, [], [])


def propagate(
    labels: Labels, rows: NDArray[np.int64], columns: NDArray[np.int64], known: Bools, regions: Labels
) -> Labels:
    """Propagate (H, W) int32 labels, -1 for none, to the next frame: a fine region takes the label of most of its pixels.

    A pixel that was hidden, out of view or without a label has no vote. ``rows``, ``columns``, ``known``: from ``find_origins``;
    ``regions``: (H, W) int32 fine regions of the next frame, -1 for none.
    """
    brought = np.where(known, labels[rows, columns], np.int32(-1))
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
    won = (voters >= LEAST_SUPPORT * size) & (most >= PURITY * voters) & (voters > 0)
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

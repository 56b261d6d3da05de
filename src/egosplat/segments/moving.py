"""Track what moves, where the transient network says that something does, and add the tracks to single masks."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from egosplat.arrays import Floats, Reals
from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.models.sam2_loader import Sam2
from egosplat.moving_regions import InstanceScores
from egosplat.segments.options import SegmentsOptions
from egosplat.segments.tracker import Tracker
from egosplat.segments.video import Segmented, Video, finalize_instances

# A single mask shows a moving thing if tracks of moving things cover a larger share of it.
_MOSTLY = 0.5


def track_moving(
    sam2: Sam2,
    video: Video,
    options: SegmentsOptions,
    probability: Callable[[int], Reals],
    training: NDArray[np.intp],
    checkpoint: Checkpoint | None = None,
) -> Segmented:
    """Track what moves: merge duplicates, and drop tracks that are short or do not move after all. The
    transient network also calls some static pixels moving, and SAM2's tracks slip to what is behind. So a
    track ends in frames in which its mean probability is low, and it takes more to keep a track than to start
    one: its mean probability over all its pixels in the ``training`` frames, of which the key
    frames are prompted. ``probability``: returns the (H, W) probability in 0..1 that a
    frame's pixels move."""

    def moves(frame: int) -> Floats:
        return np.where(video.shown(frame), probability(frame).astype(np.float32), np.float32(0))

    prompted = options.key_frames(training).tolist()
    found = Tracker(sam2, video, options, moves, prompted).run(checkpoint)
    table, kept, _ = finalize_instances(found, options.min_frames)
    scores = InstanceScores(len(kept))
    for frame in training.tolist():
        scores.add(table[found.labels[frame]], moves(frame))
    moving = scores.scores >= options.threshold
    table = np.append(np.where(moving, np.cumsum(moving) - 1, -1), -1).astype(np.int32)[table]
    for frame in range(video.length):
        found.labels[frame] = table[found.labels[frame]]
    tracks = [replace(found.instances[number], moving=True) for number in kept[moving]]
    return replace(found, instances=tracks, same=[])


def add_tracks(single: Segmented, tracked: Segmented) -> Segmented:
    """Add the tracks of what moves to the masks of single frames, of the same video: the masks, then the
    tracks. A mask that tracks cover for the most part is without pixels. Where a track of any level is, no
    single mask stays. The labels of ``single`` change."""
    count = len(single.instances)
    for frame in range(len(single.labels)):
        masks, tracks = single.labels[frame], tracked.labels[frame]
        moving, covered = (tracks >= 0).any(axis=0), InstanceScores(count)
        covered.add(masks, moving)
        dropped = np.append(covered.scores > _MOSTLY, False)
        left = np.where(moving | dropped[masks], -1, masks)
        single.labels[frame] = np.where(tracks >= 0, tracks + count, left)
    return replace(single, instances=single.instances + tracked.instances)

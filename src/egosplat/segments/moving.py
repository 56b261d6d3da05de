"""Track what moves, where the transient network says that something does, and add the tracks to single masks."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.models.sam2_loader import Sam2
from egosplat.moving_regions import InstanceScores
from egosplat.segments.instances import Segmented, Video, finalize_instances
from egosplat.segments.label_maps import LabelMaps, Labels
from egosplat.segments.nms import areas
from egosplat.segments.options import SegmentsOptions
from egosplat.segments.prompts import Candidates, prompted_frames
from egosplat.segments.propagation import Accepts
from egosplat.segments.tracker import Tracker

# All three are decided by the mean probability of a mask or track. The last one, of a track over all training frames, has to
# reach masks.threshold: the transient network is surer of what moves than of static things, whose tracks reach 0.60 to 0.70,
# true ones 0.70 to 1 (benchmarks/transient/README.md). A mask is less sure than its track, so a track starts at this share:
_STARTS = 6 / 7

# A track is lost in frames in which SAM2 follows something else, or the thing rests: below this share.
_LOST = 3 / 7

# A single mask shows a moving thing if tracks of moving things cover a larger share of it.
_MOSTLY = 0.5


class MovingTracker(Tracker):
    """Prompts only pixels that may move, and keeps only tracks whose mean probability reaches the threshold.

    The transient network also calls some static pixels moving, and SAM2's tracks slip to what is behind. So a track
    ends in frames in which its mean probability is low, and it takes more to keep a track than to start one.
    """

    # What moves again later is prompted again. Or else the time would grow with tracks times frames.
    _LOST_TRACKS_END = True

    def __init__(
        self,
        sam2: Sam2,
        video: Video,
        options: SegmentsOptions,
        probability: Callable[[int], NDArray[np.floating]],
        training: NDArray[np.intp],
    ) -> None:
        """Set up for a video.

        Args:
            probability: returns the (H, W) probability in 0..1 that a frame's pixels move; not finite counts as 0.
            training: indices of the frames that may be prompted.
        """
        super().__init__(sam2, video, options)
        self._probability, self._training = probability, training.tolist()
        self._searched = frozenset(prompted_frames(training, options))

    def moving_tracks(self, checkpoint: Checkpoint | None = None) -> Segmented:
        """Track as in ``run``, merge duplicates, and drop tracks that are short or do not move after all.

        The mean probability over all its pixels in the frames that may be prompted decides whether a track moves.
        """
        found = self.run(checkpoint)
        final = finalize_instances(found, self._options.min_frames)
        scores = InstanceScores(len(final.kept))
        for frame in self._training:
            scores.add(final.table[found.labels[frame]], self._values(frame))
        moves = scores.scores >= self._options.threshold
        table = np.append(np.where(moves, np.cumsum(moves) - 1, -1), -1).astype(np.int32)[final.table]
        labels = LabelMaps(found.labels[0].shape)
        for frame in range(len(found.labels)):
            labels[frame] = table[found.labels[frame]]
        tracks = [replace(found.instances[number], moving=True) for number in final.kept[moves]]
        return Segmented(labels, tracks, [], found.prompted)

    def _prompts(self, frame: int) -> bool:
        return frame in self._searched

    def _search_area(self, frame: int) -> tuple[Tensor, float]:
        # Hands are small: as few pixels as a mask may have are searched.
        moving = self._inside(frame) & (self._moving(frame) >= _STARTS * self._options.threshold)
        return moving, self._options.min_area * moving.numel()

    def _may_start(self, frame: int, found: Candidates) -> Candidates:
        return found.take(_mean_reaches(_STARTS * self._options.threshold, found.masks, self._moving(frame)))

    def _accepts(self, frame: int) -> Accepts:
        moving = cache(lambda: self._moving(frame))
        least = _LOST * self._options.threshold
        return lambda logits: _mean_reaches(least, logits > 0, moving())

    def _moving(self, frame: int) -> Tensor:
        """(M, M) float32 probability at the size of the model's masks."""
        large = torch.from_numpy(self._values(frame))[None, None].to(self._device)
        return F.interpolate(large, self._size, mode="area")[0, 0]

    def _values(self, frame: int) -> NDArray[np.float32]:
        """(H, W) probability; 0 where the pixel does not show the scene."""
        return np.where(self._video.shown(frame), self._probability(frame).astype(np.float32), np.float32(0))


def _mean_reaches(least: float, masks: Tensor, probability: Tensor) -> Tensor:
    """(K,) bool, whether the mean probability inside each (K, M, M) bool mask is ``least`` or more."""
    # Summed instead of multiplied as matrices, which bfloat16 would round.
    return (masks * probability).flatten(1).sum(1) >= least * areas(masks)


def add_tracks(single: Segmented, tracked: Segmented) -> Segmented:
    """Add the tracks of what moves to the masks of single frames, of the same video: the masks, then the tracks.

    A mask that tracks cover for the most part is without pixels.
    """
    first, labels = len(single.instances), LabelMaps(single.labels[0].shape)
    for frame in range(len(single.labels)):
        tracks = tracked.labels[frame]
        labels[frame] = _overlay(single.labels[frame], np.where(tracks < 0, -1, tracks + first))
    return Segmented(labels, single.instances + tracked.instances, single.same, single.prompted)


def _overlay(single: Labels, tracks: Labels) -> Labels:
    """(L, H, W) labels of a frame: tracks over single masks. Where a track of any level is, no single mask stays."""
    moving, found = (tracks >= 0).any(axis=0), single >= 0
    count = int(single.max(initial=-1)) + 1
    area = np.bincount(single[found], minlength=count)
    covered = np.bincount(single[found & moving], minlength=count)
    dropped = np.append(covered > _MOSTLY * area, False)
    return np.where(tracks >= 0, tracks, np.where(moving | dropped[single], -1, single))

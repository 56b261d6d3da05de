"""Track a video with SAM2: forwards from the frames that are prompted, then backwards."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.checkpoint import Checkpoint, State
from egosplat.models.image_encoder import EncodedImage, encode
from egosplat.models.sam2_loader import Sam2
from egosplat.progress import log, track
from egosplat.segments.instances import Overlaps, Segmented, Track, Video
from egosplat.segments.label_maps import DamagedLabels, LabelMaps, Labels, paint
from egosplat.segments.nms import union
from egosplat.segments.options import LEVELS, SegmentsOptions
from egosplat.segments.prompts import Candidates, drop_covered, filter_masks, grid_points, lie_in, prompt
from egosplat.segments.propagation import Accepts, Group, Propagator, restart

# Numbers of K instances of a level and their (K, M, M) float32 logits, or bool masks, in one frame.
LevelMasks = tuple[list[int], Tensor]

# A new mask is dropped if tracked instances cover a larger fraction of it.
_MAX_COVERED_NEW = 0.5

# Objects per SAM2 batch. The order of sums, and so the last digit, depends on it.
BATCH = 16


@dataclass
class _Level:
    """The tracked objects of a level, and the overlaps of their masks."""

    groups: list[Group] = field(default_factory=list)
    overlaps: Overlaps = field(default_factory=Overlaps)


class Tracker:
    """Tracks all levels of a video with SAM2 at once, so that each frame is encoded once per direction."""

    # Whether an object that is out of view for long is no longer searched for.
    _LOST_TRACKS_END = False

    def __init__(self, sam2: Sam2, video: Video, options: SegmentsOptions) -> None:
        """Set up, without reading a frame's image."""
        self._sam2, self._video, self._frames = sam2, video, video.length
        self._options = options
        self._levels = [_Level() for _ in LEVELS]
        self._instances: list[Track] = []
        self._labels = LabelMaps((len(LEVELS), *video.shown(0).shape))
        self._propagator = Propagator(
            sam2, video.length, options.lost_track_stride, lost_tracks_end=self._LOST_TRACKS_END
        )
        self._prompted: list[int] = []
        self._ahead = self._back = 0
        side = sam2.video_predictor.image_size // 4  # of SAM2's low-resolution masks
        self._size, self._device = (side, side), sam2.compute.device
        # Most recordings have the same pixels in every frame: they are shrunk once.
        self._inside_of: tuple[NDArray[np.bool_], Tensor] | None = None

    def run(self, checkpoint: Checkpoint | None = None) -> Segmented:
        """Track the video in both directions, resuming from the checkpoint if it holds a state."""
        if checkpoint is None:
            return self._track_video(lambda: None)
        self._labels.path = checkpoint.file.with_name("labels")
        if (saved := checkpoint.load()) is not None:
            try:
                self._load_state_dict(saved)
                log(f"tracking resumes after {self._ahead} frames forwards and {self._back} backwards")
            except DamagedLabels as error:
                log(str(error))
        return self._track_video(lambda: checkpoint.save_if_due(self._state_dict))

    def _track_video(self, save: Callable[[], None]) -> Segmented:
        """Track what is left of the video in both directions; ``save`` is called after each frame."""
        with self._sam2.compute.inference():
            for frame in track(range(self._ahead, self._frames), "tracking instances forwards"):
                self._forwards(frame)
                self._ahead += 1
                save()
            # The backward pass starts from each track's first frame; a resumed one has started already.
            if not self._back:
                for level in self._levels:
                    level.groups = [restart(group) for group in level.groups]
            # No track begins after frame ``last``, so later frames have nothing to track backwards.
            last = max((group.first_frame for level in self._levels for group in level.groups), default=0)
            for frame in track(range(last - 1 - self._back, -1, -1), "tracking instances backwards"):
                self._backwards(frame)
                self._back += 1
                save()
        return Segmented(self._labels, self._instances, self._same(), self._prompted)

    def _state_dict(self) -> State:
        return {
            "ahead": self._ahead,
            "back": self._back,
            "prompted": self._prompted,
            "instances": [vars(instance) for instance in self._instances],
            "labels": self._labels.state_dict(),
            "groups": [[vars(group) for group in level.groups] for level in self._levels],
            "overlaps": [level.overlaps.state_dict() for level in self._levels],
        }

    def _load_state_dict(self, state: State) -> None:
        self._labels.load_state_dict(state["labels"])
        self._ahead, self._back, self._prompted = state["ahead"], state["back"], state["prompted"]
        self._instances = [Track(**values) for values in state["instances"]]
        for level, groups, overlaps in zip(self._levels, state["groups"], state["overlaps"], strict=True):
            level.groups = [Group.restored(saved, self._device) for saved in groups]
            level.overlaps.load_state_dict(overlaps)

    def _encoded(self, frame: int) -> Callable[[], EncodedImage]:
        """A function that reads and encodes a frame when it is first called."""
        return cache(lambda: encode(self._sam2, self._video.image(frame)))

    def _inside(self, frame: int) -> Tensor:
        """(M, M) bool pixels of the small masks of which more than half the area shows the scene."""
        shown = self._video.shown(frame)
        if self._inside_of is None or self._inside_of[0] is not shown:
            large = torch.from_numpy(shown)[None, None].float()
            inside = F.interpolate(large, self._size, mode="area")[0, 0] > 0.5
            self._inside_of = shown, inside.to(self._device)
        return self._inside_of[1]

    def _prompts(self, frame: int) -> bool:
        """Whether new objects are searched for in a frame."""
        return frame == 0

    def _search_area(self, frame: int) -> tuple[Tensor, float]:
        """(M, M) bool pixels where new objects are searched for, and the number of untracked ones that is too few."""
        return self._inside(frame), 0.0

    def _may_start(self, frame: int, found: Candidates) -> Candidates:
        """The masks that may start a track."""
        return found

    def _accepts(self, frame: int) -> Accepts | None:
        """Decides which masks continue their track in a frame; None for all."""
        return None

    def _propagated(
        self, encoded: Callable[[], EncodedImage], frame: int, *, reverse: bool
    ) -> list[list[LevelMasks]]:
        """The masks of each level's tracks in the next frame of a direction."""
        accepts = self._accepts(frame)
        return [
            [
                (group.ids, self._propagator.step(encoded, frame, group, reverse, accepts))
                for group in level.groups
                if not (reverse and group.first_frame <= frame) and not self._propagator.ended(group)
            ]
            for level in self._levels
        ]

    def _forwards(self, frame: int) -> None:
        encoded = self._encoded(frame)
        seen = self._propagated(encoded, frame, reverse=False)
        if self._prompts(frame):
            self._add_new_tracks(encoded, frame, seen)
        for level, masks in zip(self._levels, seen, strict=True):
            level.overlaps.add(*self._stacked(masks, frame))
        self._labels[frame] = np.stack([self._paint(masks, frame) for masks in seen])
        if self._prompts(frame):
            self._end_duplicates()

    def _end_duplicates(self) -> None:
        """End tracks of what an earlier track follows as well; the two are merged."""
        duplicates = {later for _, later in self._same()}
        for group in (group for level in self._levels for group in level.groups):
            group.end(duplicates)

    def _same(self) -> list[tuple[int, int]]:
        """Pairs of instances of a level that are one object, as far as they have been tracked."""
        merge_iou = self._options.merge_iou
        return [pair for level in self._levels for pair in level.overlaps.same(merge_iou, self._frames)]

    def _backwards(self, frame: int) -> None:
        labels = self._labels[frame]
        seen = self._propagated(self._encoded(frame), frame, reverse=True)
        for own, level, masks in zip(labels, self._levels, seen, strict=True):
            back = self._stacked(masks, frame)
            level.overlaps.add(*back)
            # Tracks of the forward pass are compared by their labels, because their logits are not kept.
            level.overlaps.add_between(*back, *self._as_masks(own))
            # Labels of the forward pass take precedence.
            own[:] = np.where(own >= 0, own, self._paint(masks, frame))
        self._labels[frame] = labels

    def _add_new_tracks(
        self, encoded: Callable[[], EncodedImage], frame: int, seen: list[list[LevelMasks]]
    ) -> None:
        """Prompt the pixels that a level does not cover, and start tracks of the new objects found there."""
        tracked = [self._stacked(masks, frame)[1] for masks in seen]
        area, least = self._search_area(frame)
        free = [area & ~union(masks) for masks in tracked]
        searched = [level for level, pixels in enumerate(free) if float(pixels.sum()) > least]
        # SAM2 gives the masks of all levels for one prompt, so a point is prompted if any level needs it.
        wanted = torch.zeros_like(area)
        for level in searched:
            wanted |= free[level]
        points = grid_points(self._options.points_per_side)
        points = points[lie_in(points, wanted).cpu()]
        if not len(points):
            return
        self._prompted.append(frame)
        found = prompt(self._sam2, encoded(), points, self._options)
        iou_thresh = self._options.mask_filter.nms_iou_thresh
        for level in reversed(searched):
            new = filter_masks(self._may_start(frame, found[level]), self._options)
            new = drop_covered(new, tracked[level], _MAX_COVERED_NEW, iou_thresh)
            self._begin(encoded(), frame, level, new, seen[level])

    def _begin(
        self, encoded: EncodedImage, frame: int, level: int, new: Candidates, seen: list[LevelMasks]
    ) -> None:
        """Start tracks of the best new masks, and add them to those that are seen in the frame."""
        groups = self._levels[level].groups
        # The sort is stable, so that equal scores keep their order.
        room = max(0, self._options.max_instances - sum(len(group.ids) for group in groups))
        new = new.take(new.scores.argsort(descending=True, stable=True)[:room])
        first = len(self._instances)
        scores = zip(new.predicted_iou.tolist(), new.stability.tolist(), strict=True)
        self._instances += [Track(level, frame, iou, stability) for iou, stability in scores]
        # Memory attention takes memory in proportion to the objects of a batch.
        for start in range(0, len(new), BATCH):
            logits = new.logits[start : start + BATCH]
            ids = [*range(first + start, first + start + len(logits))]
            groups.append(self._propagator.begin(encoded, frame, ids, logits))
            seen.append((ids, logits))

    def _stacked(self, seen: list[LevelMasks], frame: int) -> LevelMasks:
        """Join the groups of a level: all numbers, and (K, M, M) bool masks of pixels that show the scene."""
        inside = self._inside(frame)
        if not seen:
            return [], inside.new_zeros(0, *inside.shape)
        masks = torch.cat([logits > 0 for _, logits in seen])
        return [number for ids, _ in seen for number in ids], masks & inside

    def _paint(self, seen: list[LevelMasks], frame: int) -> Labels:
        return paint(seen, self._video.shown(frame), self._device)

    def _as_masks(self, labels: Labels) -> LevelMasks:
        """The instances of a label map as masks at the size of the model's masks."""
        side = self._size[0]
        # Labels cannot be averaged: the pixel in the middle of each cell stands for it.
        rows, columns = ((np.arange(side) + 0.5) * length / side for length in labels.shape)
        small = torch.from_numpy(labels[np.ix_(rows.astype(int), columns.astype(int))]).to(self._device)
        ids = [number for number in small.unique().tolist() if number >= 0]
        masks = small == torch.tensor(ids, dtype=small.dtype, device=small.device)[:, None, None]
        return ids, masks

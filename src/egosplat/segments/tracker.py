"""Track a video with SAM2: forwards, with new prompts where no instance is tracked, then backwards."""

from collections.abc import Callable
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
from egosplat.segments.instances import Segmented, Track
from egosplat.segments.label_maps import DamagedLabels, LabelMaps, paint
from egosplat.segments.levels import Level, LevelMasks, add_shared, stack_masks
from egosplat.segments.nms import union
from egosplat.segments.options import LEVELS, SegmentsOptions
from egosplat.segments.prompts import (
    Candidates,
    drop_covered,
    filter_masks,
    grid_points,
    lie_in,
    match_masks,
    prompt,
)
from egosplat.segments.propagation import Accepts, Propagator, restart

# A level is prompted again if instances leave a larger fraction of the valid pixels uncovered.
_MIN_UNCOVERED = 0.05

# A new mask is dropped if tracked instances cover a larger fraction of it.
_MAX_COVERED_NEW = 0.5

# Objects per SAM2 batch. The order of sums, and so the last digit, depends on it.
BATCH = 16


class Tracker:
    """Tracks all levels of a video with SAM2 at once, so that each frame is encoded once per direction."""

    # Whether an object that is out of view for long is no longer searched for.
    _LOST_TRACKS_END = False

    def __init__(
        self,
        sam2: Sam2,
        images: Callable[[int], NDArray[np.uint8]],
        frames: int,
        valid: NDArray[np.bool_],
        options: SegmentsOptions,
        shown: Callable[[int], NDArray[np.bool_]] | None = None,
    ) -> None:
        """Set up for a video.

        Args:
            images: returns the (H, W, 3) uint8 RGB image of a frame index.
            valid: (H, W) bool, pixels that show the scene.
            shown: returns the (H, W) bool pixels of a frame index that show the scene; None: ``valid`` for all.
        """
        self._sam2, self._images, self._frames = sam2, images, frames
        self._shown = shown or (lambda _: valid)
        self._options = options
        self._levels = [Level() for _ in LEVELS]
        self._instances: list[Track] = []
        self._labels = LabelMaps((len(LEVELS), *valid.shape))
        self._propagator = Propagator(
            sam2, frames, options.lost_track_stride, lost_tracks_end=self._LOST_TRACKS_END
        )
        self._key_frames: list[int] = []
        self._ahead = self._back = 0
        side = sam2.video_predictor.image_size // 4  # of SAM2's low-resolution masks
        self._size, self._device = (side, side), sam2.compute.device
        # Most recordings have the same pixels in every frame: they are shrunk once.
        self._inside_of: tuple[NDArray[np.bool_], Tensor] | None = None

    def run(self, checkpoint: Checkpoint | None = None) -> Segmented:
        """Track the video in both directions, resuming from the checkpoint if it holds a state."""
        if checkpoint is None:
            return self.track_video(lambda: None)
        self._labels.path = checkpoint.file.with_name("labels")
        if (saved := checkpoint.load()) is not None:
            try:
                self.load_state_dict(saved)
                log(f"tracking resumes after {self._ahead} frames forwards and {self._back} backwards")
            except DamagedLabels as error:
                log(str(error))
        return self.track_video(lambda: checkpoint.save_if_due(self.state_dict))

    def track_video(self, save: Callable[[], None]) -> Segmented:
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
        same = [pair for level in self._levels for pair in self._same(level)]
        return Segmented(self._labels, self._instances, same, {"key_frames": self._key_frames})

    def state_dict(self) -> State:
        """The progress as tensors, numbers, lists and dictionaries."""
        return {
            "ahead": self._ahead,
            "back": self._back,
            "key_frames": self._key_frames,
            "instances": [vars(instance) for instance in self._instances],
            "labels": self._labels.state_dict(),
            "levels": [level.state_dict() for level in self._levels],
        }

    def load_state_dict(self, state: State) -> None:
        """Resume from a ``state_dict``."""
        self._labels.load_state_dict(state["labels"])
        self._ahead, self._back = state["ahead"], state["back"]
        self._key_frames = state["key_frames"]
        self._instances = [Track(**values) for values in state["instances"]]
        for level, saved in zip(self._levels, state["levels"], strict=True):
            level.load_state_dict(saved, self._sam2.compute.device)

    def _encoded(self, frame: int) -> Callable[[], EncodedImage]:
        """A function that reads and encodes a frame when it is first called."""
        return cache(lambda: encode(self._sam2, self._images(frame)))

    def _inside(self, frame: int) -> Tensor:
        """(M, M) bool pixels of the small masks of which more than half the area shows the scene."""
        shown = self._shown(frame)
        if self._inside_of is None or self._inside_of[0] is not shown:
            large = torch.from_numpy(shown)[None, None].float()
            inside = F.interpolate(large, self._size, mode="area")[0, 0] > 0.5
            self._inside_of = shown, inside.to(self._device)
        return self._inside_of[1]

    def _prompts(self, frame: int) -> bool:
        """Whether new objects are searched for in a frame."""
        keys = self._options
        return frame == 0 or (keys.prompting == "key_frames" and frame % keys.key_frame_stride == 0)

    def _search_area(self, frame: int) -> tuple[Tensor, float]:
        """(M, M) bool pixels where new objects are searched for, and the number of untracked ones that is too few."""
        # Slivers between masks are no reason to prompt.
        inside = self._inside(frame)
        return inside, _MIN_UNCOVERED * float(inside.sum())

    def _may_start(self, frame: int, found: Candidates) -> Candidates:
        """The masks that may start a track."""
        return found

    def _accepts(self, frame: int) -> Accepts | None:
        """Decides which masks continue their track in a frame; None for all."""
        return None

    def _propagated(
        self, encoded: Callable[[], EncodedImage], frame: int, *, reverse: bool
    ) -> list[list[LevelMasks]]:
        """The masks of each level's tracks in the next frame of a direction, with those that levels share."""
        accepts = self._accepts(frame)
        seen = [
            [
                (group.ids, self._propagator.step(encoded, frame, group, reverse, accepts))
                for group in level.groups
                if not (reverse and group.first_frame <= frame) and not self._propagator.ended(group)
            ]
            for level in self._levels
        ]
        add_shared(self._levels, seen)
        return seen

    def _forwards(self, frame: int) -> None:
        encoded = self._encoded(frame)
        seen = self._propagated(encoded, frame, reverse=False)
        if self._prompts(frame):
            self._add_new_tracks(encoded, frame, seen)
        for level, found in zip(self._levels, seen, strict=True):
            level.overlaps.add(*stack_masks(found, self._inside(frame)))
        self._labels[frame] = np.stack([self._paint(found, frame) for found in seen])
        if self._prompts(frame):
            self._end_duplicates()

    def _end_duplicates(self) -> None:
        """End tracks of what an earlier track follows as well; the two are merged. A track that levels share ends if all do."""
        duplicates = {other for level in self._levels for _, other in self._same(level)}
        shared = {
            tracked
            for level in self._levels
            for number, tracked in level.shared.items()
            if number not in duplicates
        }
        ended = duplicates - shared
        for level in self._levels:
            for group in level.groups:
                group.end(ended)

    def _same(self, level: Level) -> list[tuple[int, int]]:
        """Pairs of a level's instances that are one object, as far as they have been tracked."""
        return level.overlaps.same(self._options.merge_iou, self._frames)

    def _backwards(self, frame: int) -> None:
        labels = self._labels[frame]
        seen = self._propagated(self._encoded(frame), frame, reverse=True)
        for number, (level, found) in enumerate(zip(self._levels, seen, strict=True)):
            back = stack_masks(found, self._inside(frame))
            level.overlaps.add(*back)
            # Tracks of the forward pass are compared by their labels, because their logits are not kept.
            level.overlaps.add_between(*back, *self._as_masks(labels[number]))
            # Labels of the forward pass take precedence.
            labels[number] = np.where(labels[number] >= 0, labels[number], self._paint(found, frame))
        self._labels[frame] = labels

    def _add_new_tracks(
        self, encoded: Callable[[], EncodedImage], frame: int, seen: list[list[LevelMasks]]
    ) -> None:
        """Prompt the pixels that a level does not cover, and start tracks of the new objects found there."""
        inside = self._inside(frame)
        tracked = [stack_masks(found, inside)[1] for found in seen]
        area, least = self._search_area(frame)
        free = [area & ~union(masks) for masks in tracked]
        searched = [number for number, place in enumerate(free) if float(place.sum()) > least]
        points = grid_points(self._options.points_per_side)
        # SAM2 gives the masks of all levels for one prompt, so a point is prompted if any level needs it.
        wanted = torch.zeros_like(inside)
        for number in searched:
            wanted |= free[number]
        points = points[lie_in(points, wanted).cpu()]
        if not len(points):
            return
        self._key_frames.append(frame)
        found = prompt(self._sam2, encoded(), points, self._options)
        begun: LevelMasks = [], inside.new_zeros(0, *self._size)
        # Coarse levels first: a finer mask equal to a coarser one shares its track.
        for number in reversed(searched):
            new = filter_masks(self._may_start(frame, found[number]), self._options)
            new = drop_covered(
                new, tracked[number], _MAX_COVERED_NEW, self._options.mask_filter.nms_iou_thresh
            )
            # ``max_instances`` keeps the best masks; the sort is stable, so that equal scores keep their order.
            room = max(0, self._options.max_instances - self._levels[number].instances)
            new = new.take(new.scores.argsort(descending=True, stable=True)[:room])
            alike = match_masks(new.masks, begun[1], self._options.cross_level_iou)
            self._begin_shared(
                frame,
                number,
                new.take(alike >= 0),
                [begun[0][place] for place in alike[alike >= 0].tolist()],
                seen[number],
            )
            ids = self._begin(encoded(), frame, number, new.take(alike < 0), seen[number])
            begun = begun[0] + ids, torch.cat([begun[1], new.take(alike < 0).masks])

    def _begin(
        self, encoded: EncodedImage, frame: int, level: int, new: Candidates, seen: list[LevelMasks]
    ) -> list[int]:
        """Start tracks; returns the numbers of the instances."""
        ids = self._add_instances(frame, level, new)
        # Memory attention takes memory in proportion to the objects of a batch.
        for first in range(0, len(ids), BATCH):
            some = slice(first, first + BATCH)
            self._levels[level].groups.append(
                self._propagator.begin(encoded, frame, ids[some], new.logits[some])
            )
            seen.append((ids[some], new.logits[some]))
        return ids

    def _begin_shared(
        self, frame: int, level: int, new: Candidates, tracked: list[int], seen: list[LevelMasks]
    ) -> None:
        """Add instances that are ``tracked`` for another level already, under these numbers."""
        ids = self._add_instances(frame, level, new)
        if ids:
            self._levels[level].shared |= dict(zip(ids, tracked, strict=True))
            seen.append((ids, new.logits))

    def _add_instances(self, frame: int, level: int, new: Candidates) -> list[int]:
        scores = zip(new.predicted_iou.tolist(), new.stability.tolist(), strict=True)
        first = len(self._instances)
        self._instances += [Track(level, frame, iou, stability) for iou, stability in scores]
        return list(range(first, len(self._instances)))

    def _paint(self, seen: list[LevelMasks], frame: int) -> NDArray[np.int32]:
        return paint(seen, self._shown(frame), self._device)

    def _as_masks(self, labels: NDArray[np.int32]) -> LevelMasks:
        """The instances of a label map as masks at the size of the model's masks."""
        side = self._size[0]
        # Labels cannot be averaged: the pixel in the middle of each cell stands for it.
        rows, columns = ((np.arange(side) + 0.5) * length / side for length in labels.shape)
        small = torch.from_numpy(labels[np.ix_(rows.astype(int), columns.astype(int))]).to(self._device)
        ids = [number for number in small.unique().tolist() if number >= 0]
        masks = small == torch.tensor(ids, dtype=small.dtype, device=small.device)[:, None, None]
        return ids, masks

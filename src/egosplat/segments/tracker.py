"""Track a video with SAM2: forwards from the frames that are prompted, then backwards; everything, or only what moves."""

from collections.abc import Callable, Iterable
from functools import lru_cache
from itertools import chain
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from egosplat.arrays import Floats, Ints32
from egosplat.artifacts.checkpoint import Checkpoint, State, UnusableState
from egosplat.images import resize_labels
from egosplat.models.point_decoder import encode
from egosplat.models.sam2_loader import Sam2
from egosplat.progress import log, track
from egosplat.segments.masks import Candidates, areas, drop_covered, filter_masks, paint
from egosplat.segments.options import LEVELS, SegmentsOptions
from egosplat.segments.prompts import grid_points, lie_in, prompt
from egosplat.segments.propagation import Group, Propagator
from egosplat.segments.video import LabelMaps, LevelMasks, Overlaps, Segmented, Track, Video

# A new mask is dropped if tracked instances cover a larger fraction of it.
_MAX_COVERED_NEW = 0.5

# Objects per SAM2 batch. The order of sums, and so the last digit, depends on it.
BATCH = 16

# Pixels of encoded frames that are kept. Their features take 8 bytes a pixel, those of the published models 16.
_KEPT_PIXELS = 16 * 2**20

# A track starts from a mask, and is lost where SAM2 follows something else or the thing rests, by its mean probability as a
# share of masks.threshold. The track as a whole has to reach the threshold: the transient network is surer of what moves
# than of static things, whose tracks reach 0.60 to 0.70, true ones 0.70 to 1 (benchmarks/transient/README.md).
_STARTS, _LOST = 6 / 7, 3 / 7


class Tracker:
    """Tracks all levels of a video with SAM2 at once, so that each frame is encoded once per direction."""

    def __init__(
        self,
        sam2: Sam2,
        video: Video,
        options: SegmentsOptions,
        moves: Callable[[int], Floats] | None = None,
        prompted: Iterable[int] = (0,),
    ) -> None:
        """Set up, without reading a frame's image. ``moves``: returns the (H, W) probability that a frame's
        pixels move: only those that may move are prompted, and a track is lost where they hardly do. None:
        tracks follow everything. ``prompted``: frames in which objects are searched for."""
        self._sam2, self._video, self._options = sam2, video, options
        self._searched = frozenset(prompted)
        self._groups: list[list[Group]] = [[] for _ in LEVELS]
        self._overlaps = [Overlaps() for _ in LEVELS]
        self._labels = LabelMaps((video.length, len(LEVELS), *video.shown(0).shape))
        self._instances: list[Track] = []
        self._prompted: list[int] = []
        self._steps = 0  # frames done forwards, and then backwards
        self._side = sam2.video_predictor.image_size // 4  # of SAM2's low-resolution masks
        # Backwards, the last frames come first.
        kept = max(1, _KEPT_PIXELS // sam2.video_predictor.image_size**2)
        self._encoded = lru_cache(kept)(lambda frame: encode(sam2, video.image(frame)))
        everything = np.ones(video.shown(0).shape, np.float32)
        self._moving = lru_cache(1)(lambda frame: self._shrunk(moves(frame) if moves else everything))
        self._inside = lru_cache(1)(lambda frame: self._shrunk(video.shown(frame).astype(np.float32)) > 0.5)
        # What moves again later is prompted again. Or else the time would grow with tracks times frames.
        ends = moves is not None
        self._propagator = Propagator(sam2, self._encoded, video.length, lost_tracks_end=ends)

    def run(self, checkpoint: Checkpoint | None = None) -> Segmented:
        """Track the video in both directions, resuming from the checkpoint if it holds a state."""
        if checkpoint is not None and (saved := checkpoint.load()) is not None:
            try:
                self._load(saved, checkpoint.file.parent)
                log(f"tracking resumes after {self._steps} steps")
            except (OSError, UnusableState) as error:
                log(f"{checkpoint.file.parent}: labels: {error}; the stage starts again")
        frames = self._video.length
        with self._sam2.compute.inference():
            for step in track(range(self._steps, 2 * frames), "tracking instances forwards and backwards"):
                if step < frames:
                    self._forwards(step)
                else:
                    self._backwards(2 * frames - 1 - step)
                self._steps += 1
                if checkpoint is not None:
                    checkpoint.save_if_due(lambda: self._state(checkpoint.file.parent))
        return Segmented(self._labels, self._instances, self._same(), self._prompted)

    def _state(self, folder: Path) -> State:
        return {
            "steps": self._steps,
            "prompted": self._prompted,
            "instances": [vars(instance) for instance in self._instances],
            # Rewriting all labels at each checkpoint would write 200 GB in a long run.
            "labels": self._labels.save(folder),
            "groups": [[vars(group) for group in groups] for groups in self._groups],
            "overlaps": [[*map(torch.from_numpy, vars(overlaps).values())] for overlaps in self._overlaps],
        }

    def _load(self, state: State, folder: Path) -> None:
        self._labels.load(folder, state["labels"])
        self._steps, self._prompted = state["steps"], state["prompted"]
        self._instances = [Track(**values) for values in state["instances"]]
        device = self._sam2.compute.device
        self._groups = [[Group.restored(saved, device) for saved in groups] for groups in state["groups"]]
        for overlaps, saved in zip(self._overlaps, state["overlaps"], strict=True):
            overlaps.pairs, overlaps.sums = (part.numpy() for part in saved)

    def _shrunk(self, values: Floats) -> Tensor:
        """(M, M) means of (H, W) values, at the size of the model's masks."""
        large = torch.from_numpy(values)[None, None].to(self._sam2.compute.device)
        return F.interpolate(large, (self._side, self._side), mode="area")[0, 0]

    def _may_move(self, masks: Tensor, frame: int, share: float) -> Tensor:
        """(K,) bool, which (K, M, M) bool masks have a mean probability of at least a share of the threshold."""
        # Summed instead of multiplied as matrices, which bfloat16 would round.
        sums = (masks * self._moving(frame)).flatten(1).sum(1)
        return sums >= share * self._options.threshold * areas(masks)

    def _propagated(self, frame: int, *, reverse: bool) -> list[LevelMasks]:
        """The masks of each level's tracks in the next frame of a direction."""
        propagator, found = self._propagator, []
        for groups in self._groups:
            ids, logits = [], [torch.zeros(0, self._side, self._side, device=self._sam2.compute.device)]
            for group in groups:
                if not propagator.searched(group) or (reverse and group.first_frame <= frame):
                    continue
                ids += group.ids
                logits.append(
                    propagator.step(frame, group, reverse, lambda new: self._may_move(new > 0, frame, _LOST))
                )
            found.append((ids, torch.cat(logits)))
        return found

    def _forwards(self, frame: int) -> None:
        seen = self._propagated(frame, reverse=False)
        if frame in self._searched:
            self._add_new_tracks(frame, seen)
        for overlaps, (ids, logits) in zip(self._overlaps, seen, strict=True):
            overlaps.add((ids, (logits > 0) & self._inside(frame)))
        self._labels[frame] = np.stack([paint(*masks, self._video.shown(frame)) for masks in seen])
        self._end_duplicates(frame)
        if frame == self._video.length - 1:
            for group in chain(*self._groups):
                group.restart()

    def _end_duplicates(self, frame: int) -> None:
        """End tracks of what an earlier track follows as well; the two are merged."""
        duplicates = {later for _, later in self._same()} if frame in self._searched else set()
        for group in chain(*self._groups):
            group.end(duplicates)

    def _same(self) -> list[tuple[int, int]]:
        """Pairs of instances of a level that are one object, as far as they have been tracked."""
        return [pair for overlaps in self._overlaps for pair in overlaps.same(self._video.length)]

    def _backwards(self, frame: int) -> None:
        seen = self._propagated(frame, reverse=True)
        if not any(ids for ids, _ in seen):
            return
        labels = self._labels[frame]
        for own, overlaps, (ids, logits) in zip(labels, self._overlaps, seen, strict=True):
            masks = ids, (logits > 0) & self._inside(frame)
            overlaps.add(masks)
            # Tracks of the forward pass are compared by their labels, because their logits are not kept.
            overlaps.add(masks, self._as_masks(own))
            # Labels of the forward pass take precedence.
            own[:] = np.where(own >= 0, own, paint(ids, logits, self._video.shown(frame)))
        self._labels[frame] = labels
        self._end_duplicates(frame)

    def _add_new_tracks(self, frame: int, seen: list[LevelMasks]) -> None:
        """Prompt the pixels that a level does not cover, and start tracks of the new objects found there."""
        options, inside = self._options, self._inside(frame)
        area = inside & (self._moving(frame) >= _STARTS * options.threshold)
        tracked = [(logits > 0) & inside for _, logits in seen]
        free = [area & ~masks.any(0) for masks in tracked]
        # Hands are small: as few pixels as a mask may have are searched.
        least = options.min_area * area.numel()
        searched = [level for level, pixels in enumerate(free) if float(pixels.sum()) > least]
        # SAM2 gives the masks of all levels for one prompt, so a point is prompted if any level needs it.
        wanted = torch.zeros_like(area)
        for level in searched:
            wanted |= free[level]
        # Where crops show what is small in other frames, what moves needs more points.
        points = grid_points((4 if options.single_frames else 3) * options.points_per_side // 3)
        points = points[lie_in(points, wanted).cpu()]
        if not len(points):
            return
        self._prompted.append(frame)
        found, limits = prompt(self._sam2, self._encoded(frame), points, options), options.mask_filter
        for level in reversed(searched):
            new = found[level].take(self._may_move(found[level].masks, frame, _STARTS))
            new = filter_masks(new, limits)
            new = drop_covered(new, tracked[level], _MAX_COVERED_NEW, limits.nms_iou_thresh)
            seen[level] = self._begin(frame, level, new, *seen[level])

    def _begin(self, frame: int, level: int, new: Candidates, ids: list[int], logits: Tensor) -> LevelMasks:
        """Start tracks of the best new masks, and add them to those that are seen in the frame."""
        groups = self._groups[level]
        # The sort is stable, so that equal scores keep their order.
        room = max(0, self._options.max_instances - sum(map(self._propagator.searched, groups)))
        new = new.take(new.scores.argsort(descending=True, stable=True)[:room])
        numbers = [*range(len(self._instances), len(self._instances) + len(new))]
        scores = zip(new.predicted_iou.tolist(), new.stability.tolist(), strict=True)
        self._instances += [Track(level, frame, *values) for values in scores]
        # Memory attention takes memory in proportion to the objects of a batch.
        for start in range(0, len(new), BATCH):
            batch = slice(start, start + BATCH)
            groups.append(self._propagator.begin(frame, numbers[batch], new.logits[batch]))
        return ids + numbers, torch.cat([logits, new.logits])

    def _as_masks(self, labels: Ints32) -> LevelMasks:
        """The instances of a label map as masks at the size of the model's masks."""
        # Labels cannot be averaged: the pixel in the middle of each cell stands for it.
        small = torch.from_numpy(resize_labels(labels, self._side, self._side))
        small = small.to(self._sam2.compute.device)
        ids = [number for number in small.unique().tolist() if number >= 0]
        return ids, small == torch.tensor(ids, dtype=small.dtype, device=small.device)[:, None, None]

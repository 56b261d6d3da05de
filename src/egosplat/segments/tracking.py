"""SAM2 over a whole video: forwards, with new prompts where nothing is followed, then backwards."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from egosplat.models.sam2_loader import Sam2
from egosplat.progress import track
from egosplat.segments.candidates import Candidates, grid_points, only_new, prompt, thin_out
from egosplat.segments.encoding import Encoded, encode
from egosplat.segments.following import Follower, Group, restarted
from egosplat.segments.instances import Instance, Segmented
from egosplat.segments.labels import LabelMaps
from egosplat.segments.merging import Overlaps, union_of
from egosplat.segments.options import LEVELS, MaskOptions, TrackOptions
from egosplat.segments.painting import paint

Seen = tuple[list[int], Tensor]


@dataclass
class Level:
    """One level while the video is worked through."""

    groups: list[Group] = field(default_factory=list)
    overlaps: Overlaps = field(default_factory=Overlaps)

    @property
    def followed(self) -> int:
        """How many objects are followed."""
        return sum(len(group.ids) for group in self.groups)


class Tracker:
    """Segments a video with SAM2 at all levels at once, so that each frame is encoded once each way."""

    def __init__(
        self,
        sam2: Sam2,
        pictures: Callable[[int], NDArray[np.uint8]],
        frames: int,
        valid: NDArray[np.bool_],
        masks: MaskOptions,
        tracks: TrackOptions,
    ) -> None:
        """Prepare.

        Args:
            pictures: (H, W, 3) uint8 RGB of a frame, by its index.
            frames: how many there are; valid: (H, W) bool.
        """
        self._sam2, self._pictures, self._frames, self._valid = sam2, pictures, frames, valid
        self._masks, self._tracks = masks, tracks
        self._levels = [Level() for _ in LEVELS]
        self._instances: list[Instance] = []
        self._labels = LabelMaps((len(LEVELS), *valid.shape))
        self._follower = Follower(sam2, frames)
        self._key_frames: list[int] = []
        side = sam2.video_predictor.image_size // 4
        inside = torch.from_numpy(valid)[None, None].float()
        self._inside = (F.interpolate(inside, (side, side), mode="area")[0, 0] > 0.5).to(sam2.compute.device)

    def run(self) -> Segmented:
        """Work through the video, both ways."""
        with self._sam2.compute.inference():
            for frame in track(range(self._frames), "following instances forwards"):
                self._forwards(frame)
            for level in self._levels:
                level.groups = [restarted(group) for group in level.groups]
            last = max((group.first_frame for level in self._levels for group in level.groups), default=0)
            for frame in track(range(last - 1, -1, -1), "following instances backwards"):
                self._backwards(frame)
        same = [
            pair
            for level in self._levels
            for pair in level.overlaps.same(self._tracks.merge_iou, self._frames)
        ]
        return Segmented(self._labels, self._instances, same, {"key_frames": self._key_frames})

    def _forwards(self, frame: int) -> None:
        encoded = encode(self._sam2, self._pictures(frame))
        seen = [
            [(group.ids, self._follower.step(encoded, frame, group, reverse=False)) for group in level.groups]
            for level in self._levels
        ]
        if frame == 0 or (self._tracks.key_frames and frame % self._tracks.key_frame_stride == 0):
            self._look_for_more(encoded, frame, seen)
        for level, found in zip(self._levels, seen, strict=True):
            level.overlaps.add(*_together(found, self._inside))
        self._labels[frame] = np.stack([self._paint(found) for found in seen])

    def _backwards(self, frame: int) -> None:
        encoded = encode(self._sam2, self._pictures(frame))
        labels = self._labels[frame]
        for number, level in enumerate(self._levels):
            groups = [group for group in level.groups if group.first_frame > frame]
            seen = [(group.ids, self._follower.step(encoded, frame, group, reverse=True)) for group in groups]
            back = _together(seen, self._inside)
            level.overlaps.add(*back)
            level.overlaps.add_between(*back, *self._as_masks(labels[number]))
            # What was followed forwards was found earlier, and stays.
            labels[number] = np.where(labels[number] >= 0, labels[number], self._paint(seen))
        self._labels[frame] = labels

    def _look_for_more(self, encoded: Encoded, frame: int, seen: list[list[Seen]]) -> None:
        """Prompt where a level is not covered, and begin to follow what is new there."""
        followed = [_together(found, self._inside)[1] for found in seen]
        free = [self._inside & ~union_of(masks) for masks in followed]
        least = self._tracks.min_uncovered * float(self._inside.sum())
        asked = [number for number, place in enumerate(free) if float(place.sum()) > least]
        points = grid_points(self._masks.points_per_side)
        side = self._inside.shape[0]
        columns, rows = (points * side).long().T.to(self._inside.device)
        wanted = torch.zeros(len(points), dtype=torch.bool, device=self._inside.device)
        for number in asked:
            wanted |= free[number][rows, columns]
        if not wanted.any():
            return
        self._key_frames.append(frame)
        found = prompt(self._sam2, encoded, points[wanted.cpu()], self._masks)
        for number in asked:
            new = thin_out(found[number], self._masks)
            new = only_new(new, followed[number], self._tracks.new_cover_thresh, self._masks.nms_iou_thresh)
            self._begin(encoded, frame, number, new, seen[number])

    def _begin(self, encoded: Encoded, frame: int, level: int, new: Candidates, seen: list[Seen]) -> None:
        room = self._tracks.max_instances - self._levels[level].followed
        new = new.take(new.scores.argsort(descending=True, stable=True)[: max(0, room)])
        for first in range(0, len(new), self._tracks.batch):
            some = new.take(
                torch.arange(first, min(first + self._tracks.batch, len(new)), device=new.logits.device)
            )
            ids = list(range(len(self._instances), len(self._instances) + len(some)))
            facts = zip(some.predicted_iou.tolist(), some.stability.tolist(), strict=True)
            self._instances += [Instance(level, frame, iou, stability) for iou, stability in facts]
            self._levels[level].groups.append(self._follower.begin(encoded, frame, ids, some.logits))
            seen.append((ids, some.logits))

    def _paint(self, seen: list[Seen]) -> NDArray[np.int32]:
        return paint(seen, self._valid, self._sam2.compute.device)

    def _as_masks(self, labels: NDArray[np.int32]) -> Seen:
        """What a label map shows, as masks of the model's own size."""
        side = self._inside.shape[0]
        rows, columns = ((np.arange(side) + 0.5) * length / side for length in labels.shape)
        small = torch.from_numpy(labels[np.ix_(rows.astype(int), columns.astype(int))]).to(
            self._inside.device
        )
        ids = [number for number in small.unique().tolist() if number >= 0]
        masks = small == torch.tensor(ids, dtype=small.dtype, device=small.device)[:, None, None]
        return ids, masks


def _together(seen: list[Seen], inside: Tensor) -> Seen:
    """All numbers and (K, M, M) bool masks of a level in one frame."""
    if not seen:
        return [], inside.new_zeros(0, *inside.shape)
    return [number for ids, _ in seen for number in ids], torch.cat(
        [logits > 0 for _, logits in seen]
    ) & inside

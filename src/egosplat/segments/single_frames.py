"""Segment single frames with SAM2: each mask is an instance of its own."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from egosplat.artifacts.checkpoint import State
from egosplat.models.image_encoder import encode
from egosplat.models.sam2_loader import Sam2
from egosplat.segments.crops import prompt_with_crops
from egosplat.segments.instances import Segmented, Track
from egosplat.segments.label_maps import LabelMaps, pack, paint, unpack
from egosplat.segments.options import LEVELS, SegmentsOptions
from egosplat.segments.prompts import filter_masks, grid_points, lie_in, prompt


class SingleFrames:
    """Prompts frames with the whole grid of points."""

    def __init__(
        self,
        sam2: Sam2,
        images: Callable[[int], NDArray[np.uint8]],
        valid: NDArray[np.bool_],
        options: SegmentsOptions,
        shown: Callable[[int], NDArray[np.bool_]] | None = None,
    ) -> None:
        """Set up for a video.

        Args:
            sam2: the model at its own image size. Only whole frames are prompted at that of the options: crops are
                larger anyway, and tracking takes time by its fourth power.
            images, valid, options, shown: see ``Tracker``.
        """
        self._sam2, self._images, self._options = sam2, images, options
        self._shown = shown or (lambda _: valid)

    def segment(self, frame: int) -> State:
        """Segment a frame: its compressed ``labels``, and ``[level, predicted IoU, stability]`` of each of its ``masks``."""
        with self._sam2.compute.inference():
            return self._segment(frame)

    def _segment(self, frame: int) -> State:
        image = self._images(frame)
        points = grid_points(self._options.points_per_side)
        shown = self._shown(frame)
        # Where a frame shows nothing, there is nothing to segment.
        points = points[lie_in(points, torch.from_numpy(shown))]
        with self._sam2.at_side(self._options.image_size):
            found = prompt(self._sam2, encode(self._sam2, image), points, self._options)
        if self._options.crops_per_side > 1:
            found = prompt_with_crops(self._sam2, image, shown, found, self._options)
        labels, instances = [], []
        for level, candidates in enumerate(found):
            masks = filter_masks(candidates, self._options)
            ids = [*range(len(instances), len(instances) + len(masks))]
            scores = zip(masks.predicted_iou.tolist(), masks.stability.tolist(), strict=True)
            instances += [[level, iou, stability] for iou, stability in scores]
            labels.append(paint([(ids, masks.logits)], shown, self._sam2.compute.device))
        packed = torch.frombuffer(bytearray(pack(np.stack(labels))), dtype=torch.uint8)
        return {"labels": packed, "masks": instances}


def join_frames(
    found: Sequence[State], frames: Sequence[int], length: int, size: tuple[int, int]
) -> Segmented:
    """Number the masks of single frames through a video of a length and (height, width); other frames show nothing.

    Args:
        found: what ``SingleFrames.segment`` returned for each of ``frames``.
    """
    shape = (len(LEVELS), *size)
    labels, instances = LabelMaps(shape), []
    for frame, one in zip(frames, found, strict=True):
        own = unpack(one["labels"].numpy().tobytes(), shape)
        labels[frame] = np.where(own < 0, -1, own + len(instances))
        instances += [Track(level, frame, iou, stability) for level, iou, stability in one["masks"]]
    labels.leave_empty(set(range(length)) - set(frames))
    return Segmented(labels, instances, [], {"key_frames": [*frames]})

"""Segment single frames with SAM2: each mask is an instance of its own."""

from collections.abc import Sequence

import numpy as np
import torch

from egosplat.artifacts.checkpoint import State
from egosplat.models.image_encoder import encode
from egosplat.models.sam2_loader import Sam2
from egosplat.segments.crops import prompt_with_crops
from egosplat.segments.instances import Segmented, Track, Video
from egosplat.segments.label_maps import LabelMaps, pack, paint, unpack
from egosplat.segments.options import LEVELS, SegmentsOptions
from egosplat.segments.prompts import filter_masks, grid_points, lie_in, prompt


def segment_frame(sam2: Sam2, video: Video, frame: int, options: SegmentsOptions) -> State:
    """Prompt a frame with the whole grid of points.

    Args:
        sam2: at its own image size. Only the whole frame is prompted at that of the options: crops are larger anyway.

    Returns:
        Its compressed ``labels``, and ``[level, predicted IoU, stability]`` of each of its ``masks``.
    """
    image, inside, points = video.image(frame), video.shown(frame), grid_points(options.points_per_side)
    # Where a frame shows nothing, there is nothing to segment.
    points = points[lie_in(points, torch.from_numpy(inside))]
    labels, instances = [], []
    with sam2.compute.inference():
        with sam2.at_side(options.image_size):
            found = prompt(sam2, encode(sam2, image), points, options)
        if options.crops_per_side > 1:
            found = prompt_with_crops(sam2, image, inside, found, options)
        for level, candidates in enumerate(found):
            masks = filter_masks(candidates, options)
            ids = [*range(len(instances), len(instances) + len(masks))]
            scores = zip(masks.predicted_iou.tolist(), masks.stability.tolist(), strict=True)
            instances += [[level, iou, stability] for iou, stability in scores]
            labels.append(paint([(ids, masks.logits)], inside, sam2.compute.device))
    packed = torch.frombuffer(bytearray(pack(np.stack(labels))), dtype=torch.uint8)
    return {"labels": packed, "masks": instances}


def join_frames(
    found: Sequence[State], frames: Sequence[int], length: int, size: tuple[int, int]
) -> Segmented:
    """Number the masks of single frames through a video of a length and (height, width); other frames show nothing.

    Args:
        found: what ``segment_frame`` returned for each of ``frames``.
    """
    shape = (len(LEVELS), *size)
    labels, instances = LabelMaps(shape), []
    for frame, one in zip(frames, found, strict=True):
        own = unpack(one["labels"].numpy().tobytes(), shape)
        labels[frame] = np.where(own < 0, -1, own + len(instances))
        instances += [Track(level, frame, iou, stability) for level, iou, stability in one["masks"]]
    labels.leave_empty(set(range(length)) - set(frames))
    return Segmented(labels, instances, [], [*frames])

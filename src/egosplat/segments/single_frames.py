"""Segment single frames with SAM2, also in overlapping crops, where small things are larger for the model."""

from collections.abc import Sequence
from itertools import product

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.checkpoint import State
from egosplat.models.point_decoder import encode
from egosplat.models.sam2_loader import Sam2
from egosplat.segments.masks import Candidates, drop_covered, filter_masks, join, paint
from egosplat.segments.options import LEVELS, SegmentsOptions
from egosplat.segments.prompts import Bounds, grid_points, lie_in, prompt
from egosplat.segments.video import LabelMaps, Segmented, Track, Video, pack, unpack

Crop = tuple[slice, slice]
"""Rows and columns of a frame [px]."""

# Overlap of neighboring crops as a share of the frame's side, in a grid of 2 x 2, as in SAM's automatic mask generator.
_OVERLAP = 512 / 1500

# A mask that ends this close to a crop's inner border is cut off [cells of its logits].
_BORDER = 2

# Masks that cover more cells of the whole frame's logits are sharp enough there. Crops see less around large things.
_COARSE_CELLS = 100

# Logit outside of a crop: clearly no part of the mask.
_OUTSIDE = -10.0


def segment_frame(sam2: Sam2, video: Video, frame: int, options: SegmentsOptions) -> State:
    """Prompt a frame with the whole grid of points, and crops of it at SAM2's own image size: they are larger
    anyway. Returns its compressed ``labels``, and ``[level, predicted IoU, stability]`` of each of its
    ``masks``."""
    image, shown = video.image(frame), video.shown(frame)
    labels, instances = [], []
    with sam2.compute.inference():
        with sam2.at_side(options.image_size):
            found = prompt(sam2, encode(sam2, image), _points(shown, options), options)
        if options.crops_per_side > 1:
            found = prompt_with_crops(sam2, image, shown, found, options)
        for level, candidates in enumerate(found):
            masks = filter_masks(candidates, options.mask_filter)
            ids = range(len(instances), len(instances) + len(masks))
            scores = zip(masks.predicted_iou.tolist(), masks.stability.tolist(), strict=True)
            instances += [[level, iou, stability] for iou, stability in scores]
            labels.append(paint(ids, masks.logits, shown))
    return {"labels": pack(np.stack(labels)), "masks": instances}


def join_frames(
    found: Sequence[State], frames: Sequence[int], length: int, size: tuple[int, ...]
) -> Segmented:
    """Number the masks that ``segment_frame`` found in each of ``frames`` through a video of a length and (height, width)."""
    labels, instances = LabelMaps((length, len(LEVELS), *size)), []
    for frame, state in zip(frames, found, strict=True):
        own = unpack(state["labels"], (len(LEVELS), *size))
        labels[frame] = np.where(own < 0, -1, own + len(instances))
        instances += [Track(level, frame, iou, stability) for level, iou, stability in state["masks"]]
    return Segmented(labels, instances, [], [*frames])


def _points(shown: NDArray[np.bool_], options: SegmentsOptions) -> Tensor:
    """(P, 2) points of the grid that lie on pixels that show the scene."""
    points = grid_points(options.points_per_side)
    return points[lie_in(points, torch.from_numpy(shown))]


def crops_of(height: int, width: int, per_side: int) -> list[Crop]:
    """Cut a frame into a grid of overlapping crops of one size, row by row."""
    axes = []
    for side in (height, width):
        length = round((side * _OVERLAP * 2 / per_side * (per_side - 1) + side) / per_side)
        starts = np.linspace(0, side - length, per_side).round().astype(int).tolist()
        axes.append([slice(start, start + length) for start in starts])
    return list(product(*axes))


def prompt_with_crops(
    sam2: Sam2,
    image: NDArray[np.uint8],
    shown: NDArray[np.bool_],
    found: list[Candidates],
    options: SegmentsOptions,
) -> list[Candidates]:
    """Add masks of small things, from crops of the (H, W, 3) image, to the candidates of each level that the
    whole frame gave. Pixels that do not show the scene, (H, W) bool ``shown``, are not prompted. The
    candidates' logits have the size of the frame's, or the larger one of ``crops_per_side`` times the
    crops'."""
    height, width = shown.shape
    crops, by_crop = crops_of(height, width, options.crops_per_side), []
    coarse_side = found[0].logits.shape[-1]
    for crop in crops:
        encoded = encode(sam2, image[crop])
        border = _inner_border(crop, shown.shape, encoded.sizes[0][0]).to(sam2.compute.device)
        share = shown[crop].size / shown.size
        # The frame's cells are too few for these masks, and no border cuts them off.
        bounds = Bounds(options.min_area / share, _COARSE_CELLS / (share * coarse_side**2), border)
        by_crop.append(prompt(sam2, encoded, _points(shown[crop], options), options, bounds))
    canvas = max(coarse_side, options.crops_per_side * by_crop[0][0].logits.shape[-1])
    merged = []
    for coarse, *fine in zip(found, *by_crop, strict=True):
        pairs = zip(fine, crops, strict=True)
        placed = [_to_canvas(masks, crop, shown.shape, canvas) for masks, crop in pairs]
        merged.append(_merge(coarse, filter_masks(join(placed), options.mask_filter), canvas, options))
    return merged


def _inner_border(crop: Crop, shape: tuple[int, ...], side: int) -> Tensor:
    """(side, side) bool: the cells of a crop's logits at its borders inside the frame."""
    border = torch.zeros(side, side, dtype=torch.bool)
    for axis, (span, length) in enumerate(zip(crop, shape, strict=True)):
        border.movedim(axis, 0)[:_BORDER] |= span.start > 0
        border.movedim(axis, 0)[-_BORDER:] |= span.stop < length
    return border


def _to_canvas(found: Candidates, crop: Crop, shape: tuple[int, ...], canvas: int) -> Candidates:
    """Resample logits of a crop at the cells of a square canvas of the whole frame."""
    axes = []
    for span, side in zip(crop, shape, strict=True):
        pixels = (torch.arange(canvas, dtype=torch.float64) + 0.5) * (side / canvas)
        # -1 to 1 is inside the crop.
        axes.append((pixels - span.start) / (span.stop - span.start) * 2 - 1)
    grid = torch.stack(torch.meshgrid(*axes, indexing="ij")[::-1], dim=-1).to(found.logits)
    grids = grid.expand(len(found), *grid.shape)
    logits = F.grid_sample(found.logits[:, None], grids, padding_mode="border", align_corners=False)[:, 0]
    inside = (grid.abs() <= 1).all(-1)
    return Candidates(torch.where(inside, logits, _OUTSIDE), found.predicted_iou, found.stability)


def _merge(coarse: Candidates, fine: Candidates, canvas: int, options: SegmentsOptions) -> Candidates:
    """Put both on one canvas. A mask of the frame is dropped where one from a crop shows the same."""
    logits = F.interpolate(coarse.logits[:, None], (canvas, canvas), mode="bilinear", align_corners=False)
    enlarged = Candidates(logits[:, 0], coarse.predicted_iou, coarse.stability)
    return join([fine, drop_covered(enlarged, fine.masks, 1.0, options.mask_filter.box_nms_thresh)])

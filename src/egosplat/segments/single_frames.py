"""Segment single frames with SAM2, also in overlapping crops, where small things are larger for the model."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from egosplat.arrays import Bools, Bytes
from egosplat.artifacts.checkpoint import State
from egosplat.models.point_decoder import encode
from egosplat.models.sam2_loader import Sam2
from egosplat.segments.masks import Candidates, areas, filter_masks, join, mask_iou, paint
from egosplat.segments.options import LEVELS, SegmentsOptions
from egosplat.segments.prompts import Bounds, grid_points, lie_in, prompt
from egosplat.segments.video import LabelMaps, Segmented, Track, Video, pack, unpack

Crop = tuple[slice, slice]
"""Rows and columns of a frame [px]."""

# Overlap of neighboring crops as a share of the frame's side, in a grid of 2 x 2, as in SAM's automatic mask generator.
_OVERLAP = 512 / 1500

# A mask that ends this close to a crop's inner border is cut off, and those of points this close [cells of logits].
_BORDERS = 2, 4

# Masks that cover more cells of the whole frame's logits are sharp enough there. Crops see less around large things.
_COARSE_CELLS = 100

# Crops find nothing where a subpart of the frame covers more cells, and its logits there and around are so many times the
# offset of stability, which follows the steepness of a model's logits (benchmarks/single_frames/README.md#crops).
_LARGE_CELLS, _CLEAR = 4 * _COARSE_CELLS, 10

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
            points = grid_points(options.points_per_side)
            points = points[lie_in(points, torch.from_numpy(shown))]
            found = prompt(sam2, encode(sam2, image), points, options)
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
    image: Bytes,
    shown: Bools,
    found: list[Candidates],
    options: SegmentsOptions,
) -> list[Candidates]:
    """Add masks of small things, from crops of the (H, W, 3) image, to the candidates of each level that the
    whole frame gave. Pixels that do not show the scene, (H, W) bool ``shown``, are not prompted. The
    candidates' logits have the size of the frame's, or the larger one of ``crops_per_side`` times the
    crops'."""
    height, width = shown.shape
    crops, by_crop = crops_of(height, width, options.crops_per_side), []
    points = grid_points(options.points_per_side)
    coarse_side, useful = found[0].logits.shape[-1], _may_be_small(found[0], shown, options)
    for crop in crops:
        encoded, share = encode(sam2, image[crop]), shown[crop].size / shown.size
        border, near = (_inner_border(crop, shown.shape, encoded.sizes[0][0], width) for width in _BORDERS)
        # The frame's cells are too few for these masks, and no border cuts them off.
        most = _COARSE_CELLS / (share * coarse_side**2)
        bounds = Bounds(options.min_area / share, most, border.to(sam2.compute.device))
        chosen = lie_in(points, useful[crop]) & ~lie_in(points, near)
        by_crop.append(prompt(sam2, encoded, points[chosen], options, bounds))
    canvas = max(coarse_side, options.crops_per_side * by_crop[0][0].logits.shape[-1])
    merged = []
    for coarse, *fine in zip(found, *by_crop, strict=True):
        pairs = zip(fine, crops, strict=True)
        placed = [_to_canvas(masks, crop, shown.shape, canvas) for masks, crop in pairs]
        merged.append(_merge(coarse, filter_masks(join(placed), options.mask_filter), canvas, options))
    return merged


def _may_be_small(subparts: Candidates, shown: Bools, options: SegmentsOptions) -> Tensor:
    """(H, W) bool pixels that show the scene, and do not lie clearly inside a large one of the frame's subparts."""
    large = subparts.take(areas(subparts.masks) > _LARGE_CELLS)
    # A small thing lowers the logits around it, too.
    lowest = -F.max_pool2d(-large.logits[:, None], 3, 1, 1)
    clear = (lowest > _CLEAR * options.mask_filter.stability_score_offset).any(0)[None]
    return torch.from_numpy(shown) & (F.interpolate(clear.float(), shown.shape)[0, 0].cpu() == 0)


def _inner_border(crop: Crop, shape: tuple[int, ...], side: int, width: int) -> Tensor:
    """(side, side) bool: the cells of a crop's logits at its borders inside the frame, of a width in cells."""
    axes = zip(crop, shape, strict=True)
    inside = [slice(width * (one.start > 0), side - width * (one.stop < length)) for one, length in axes]
    border = torch.ones(side, side, dtype=torch.bool)
    border[tuple(inside)] = False
    return border


def _to_canvas(found: Candidates, crop: Crop, shape: tuple[int, ...], canvas: int) -> Candidates:
    """Resample logits of a crop at the cells of a square canvas of the whole frame."""
    axes = []
    for span, side in zip(crop, shape, strict=True):
        pixels = (torch.arange(canvas, dtype=torch.float64) + 0.5) * (side / canvas)
        # -1 to 1 is inside the crop.
        axes.append((pixels - span.start) / (span.stop - span.start) * 2 - 1)
    grid = torch.stack(torch.meshgrid(*axes, indexing="ij")[::-1], dim=-1).to(found.logits)
    logits = F.grid_sample(found.logits[None], grid[None], padding_mode="border", align_corners=False)[0]
    inside = (grid.abs() <= 1).all(-1)
    return replace(found, logits=torch.where(inside, logits, _OUTSIDE))


def _merge(coarse: Candidates, fine: Candidates, canvas: int, options: SegmentsOptions) -> Candidates:
    """Put both on one canvas. A mask of the frame is dropped where one from a crop shows the same."""
    logits = F.interpolate(coarse.logits[:, None], (canvas, canvas), mode="bilinear", align_corners=False)
    enlarged = replace(coarse, logits=logits[:, 0])
    repeats = mask_iou(enlarged.masks, fine.masks) > options.mask_filter.box_nms_thresh
    return join([fine, enlarged.take(~repeats.any(1))])

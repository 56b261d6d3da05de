"""Prompt SAM2 on overlapping crops of a frame, where small things are larger for the model."""

from dataclasses import dataclass
from itertools import product

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from egosplat.models.image_encoder import encode
from egosplat.models.sam2_loader import Sam2
from egosplat.segments.options import SegmentsOptions
from egosplat.segments.prompts import (
    Bounds,
    Candidates,
    drop_covered,
    filter_masks,
    grid_points,
    join,
    lie_in,
    prompt,
)

# Overlap of neighboring crops as a share of the frame's side, in a grid of 2 x 2, as in SAM's automatic mask generator.
_OVERLAP = 512 / 1500

# A mask that ends this close to a crop's inner border is cut off [cells of its logits].
_BORDER = 2

# Masks that cover more cells of the whole frame's logits are sharp enough there. Crops see less around large things.
_COARSE_CELLS = 100

# Logit outside of a crop: clearly no part of the mask.
_OUTSIDE = -10.0


@dataclass(frozen=True)
class Crop:
    """A rectangle of a frame [px]; ends are exclusive."""

    top: int
    left: int
    bottom: int
    right: int

    def share_of(self, shape: tuple[int, ...]) -> float:
        """Share of a frame of (H, W, ...) pixels that the crop covers."""
        return (self.bottom - self.top) * (self.right - self.left) / (shape[0] * shape[1])


def crops_of(height: int, width: int, per_side: int) -> list[Crop]:
    """Cut a frame into a grid of overlapping crops, row by row."""
    rows, columns = (_spans(side, per_side) for side in (height, width))
    return [Crop(top, left, bottom, right) for (top, bottom), (left, right) in product(rows, columns)]


def _spans(side: int, count: int) -> list[tuple[int, int]]:
    """Start and end of equal spans that cover ``side`` pixels and overlap."""
    overlap = side * _OVERLAP * 2 / count
    length = round((overlap * (count - 1) + side) / count)
    starts = np.linspace(0, side - length, count).round().astype(int)
    return [(int(start), int(start) + length) for start in starts]


def prompt_with_crops(
    sam2: Sam2,
    image: NDArray[np.uint8],
    valid: NDArray[np.bool_],
    found: list[Candidates],
    options: SegmentsOptions,
) -> list[Candidates]:
    """Add masks of small things, from crops, to the candidates of each level that the whole frame gave.

    Args:
        image: (H, W, 3) uint8 RGB.
        valid: (H, W) bool, pixels that show the scene; others are not prompted.

    Returns:
        Candidates; their logits have the size of the frame's, or the larger one of ``crops_per_side`` times the crops'.
    """
    crops = crops_of(*image.shape[:2], options.crops_per_side)
    coarse_side = found[0].logits.shape[-1]
    by_crop = [_prompt_crop(sam2, image, valid, crop, options, coarse_side) for crop in crops]
    fine_side = by_crop[0][0].logits.shape[-1]
    canvas = max(coarse_side, options.crops_per_side * fine_side)
    merged = []
    for level, coarse in enumerate(found):
        fine = [
            _to_canvas(one[level], crop, image.shape, canvas)
            for one, crop in zip(by_crop, crops, strict=True)
        ]
        merged.append(_merge(coarse, filter_masks(join(fine), options), canvas, options))
    return merged


def _prompt_crop(
    sam2: Sam2,
    image: NDArray[np.uint8],
    valid: NDArray[np.bool_],
    crop: Crop,
    options: SegmentsOptions,
    coarse_side: int,
) -> list[Candidates]:
    place = slice(crop.top, crop.bottom), slice(crop.left, crop.right)
    points = grid_points(options.points_per_side)
    points = points[lie_in(points, torch.from_numpy(valid[place]))]
    encoded = encode(sam2, image[place])
    border = _inner_border(crop, image.shape, encoded.sizes[0][0]).to(sam2.compute.device)
    bounds = _whole_and_small(crop, image.shape, options.min_area, coarse_side, border)
    return prompt(sam2, encoded, points, options, bounds)


def _inner_border(crop: Crop, shape: tuple[int, ...], side: int) -> Tensor:
    """(side, side) bool: the cells of a crop's logits at its borders inside the frame."""
    border = torch.zeros(side, side, dtype=torch.bool)
    for inside, cells in (
        (crop.top > 0, border[:_BORDER]),
        (crop.bottom < shape[0], border[-_BORDER:]),
        (crop.left > 0, border[:, :_BORDER]),
        (crop.right < shape[1], border[:, -_BORDER:]),
    ):
        cells |= inside
    return border


def _whole_and_small(
    crop: Crop, shape: tuple[int, ...], min_area: float, coarse_side: int, border: Tensor
) -> Bounds:
    """Bounds of a crop's masks: no border cuts them off, and the frame's ``coarse_side`` cells are too few for them.

    Args:
        min_area: smallest share of the frame.
    """
    share = crop.share_of(shape)
    return Bounds(min_area / share, _COARSE_CELLS / (share * coarse_side**2), border)


def _to_canvas(found: Candidates, crop: Crop, shape: tuple[int, ...], canvas: int) -> Candidates:
    """Resample logits of a crop at the cells of a square canvas of the whole frame."""
    rows = _places(canvas, shape[0], crop.top, crop.bottom)
    columns = _places(canvas, shape[1], crop.left, crop.right)
    grid = torch.stack(torch.meshgrid(rows, columns, indexing="ij")[::-1], dim=-1).to(found.logits)
    grids = grid.expand(len(found), *grid.shape)
    logits = F.grid_sample(found.logits[:, None], grids, padding_mode="border", align_corners=False)[:, 0]
    inside = (grid.abs() <= 1).all(-1)
    return Candidates(torch.where(inside, logits, _OUTSIDE), found.predicted_iou, found.stability)


def _places(canvas: int, side: int, start: int, end: int) -> Tensor:
    """(canvas,) coordinate of each cell's center within a crop's span along one axis, where -1 to 1 is inside."""
    pixels = (torch.arange(canvas, dtype=torch.float64) + 0.5) * (side / canvas)
    return (pixels - start) / (end - start) * 2 - 1


def _merge(coarse: Candidates, fine: Candidates, canvas: int, options: SegmentsOptions) -> Candidates:
    """Put both on one canvas. A mask of the frame is dropped where one from a crop shows the same."""
    logits = F.interpolate(coarse.logits[:, None], (canvas, canvas), mode="bilinear", align_corners=False)
    enlarged = Candidates(logits[:, 0], coarse.predicted_iou, coarse.stability)
    return join([fine, drop_covered(enlarged, fine.masks, 1.0, options.mask_filter.box_nms_thresh)])

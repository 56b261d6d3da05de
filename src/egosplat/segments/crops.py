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
from egosplat.segments.nms import areas
from egosplat.segments.options import SegmentsOptions
from egosplat.segments.prompts import (
    Candidates,
    drop_repeated,
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
    by_crop = [_prompt_crop(sam2, image, valid, crop, options) for crop in crops]
    coarse_side, fine_side = (one[0].logits.shape[-1] for one in (found, by_crop[0]))
    canvas = max(coarse_side, options.crops_per_side * fine_side)
    merged = []
    for level, coarse in enumerate(found):
        fine = [
            _to_canvas(
                _whole_and_small(one[level], crop, image.shape, coarse_side), crop, image.shape, canvas
            )
            for one, crop in zip(by_crop, crops, strict=True)
        ]
        merged.append(_merge(coarse, filter_masks(join(fine), options), canvas, options))
    return merged


def _prompt_crop(
    sam2: Sam2, image: NDArray[np.uint8], valid: NDArray[np.bool_], crop: Crop, options: SegmentsOptions
) -> list[Candidates]:
    place = slice(crop.top, crop.bottom), slice(crop.left, crop.right)
    points = grid_points(options.points_per_side)
    points = points[lie_in(points, torch.from_numpy(valid[place]))]
    return prompt(sam2, encode(sam2, image[place]), points, options, frame_share=crop.share_of(image.shape))


def _whole_and_small(found: Candidates, crop: Crop, shape: tuple[int, ...], coarse_side: int) -> Candidates:
    """Drop masks that a border inside the frame cuts off, and those that the frame's ``coarse_side`` cells show, too."""
    if len(found) == 0:
        return found
    masks = found.masks
    cut = torch.zeros(len(found), dtype=torch.bool, device=masks.device)
    for inside, border in (
        (crop.top > 0, masks[:, :_BORDER]),
        (crop.bottom < shape[0], masks[:, -_BORDER:]),
        (crop.left > 0, masks[:, :, :_BORDER]),
        (crop.right < shape[1], masks[:, :, -_BORDER:]),
    ):
        if inside:
            cut |= border.flatten(1).any(1)
    cells_of_frame = areas(masks) / masks[0].numel() * crop.share_of(shape) * coarse_side**2
    return found.take(~cut & (cells_of_frame <= _COARSE_CELLS))


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
    return join([fine, drop_repeated(enlarged, fine.masks, options.mask_filter.box_nms_thresh)])

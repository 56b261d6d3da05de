"""Prompt SAM2 with a grid of points: candidate masks of each level."""

from dataclasses import dataclass

import torch
from torch import Tensor

from egosplat.models.point_decoder import EncodedImage, PointDecoder
from egosplat.models.sam2_loader import Sam2
from egosplat.segments.masks import Candidates, areas, join, stability_score
from egosplat.segments.options import MaskFilter, SegmentsOptions

# Points per call of the mask decoder: as in SAM2's automatic mask generator; on a CPU, as many as have this many pixels of
# features together. Larger batches leave its caches, smaller ones have too few rows for a product of matrices.
_POINTS_A_BATCH, _PIXELS_A_BATCH_ON_CPU = 64, 8192


@dataclass(frozen=True)
class Bounds:
    """The share of an image that its masks cover, ``least`` to ``most``, and the (M, M) bool cells that none may, or None."""

    least: float
    most: float = 1.0
    border: Tensor | None = None


def grid_points(points_per_side: int) -> Tensor:
    """(P, 2) float32 x, y in [0, 1], relative to the image's sides: the cell centers of a square grid, row by row."""
    steps = (torch.arange(points_per_side) + 0.5) / points_per_side
    return torch.cartesian_prod(steps, steps).flip(1).contiguous()


def lie_in(points: Tensor, pixels: Tensor) -> Tensor:
    """(P,) bool, which (P, 2) points x, y in [0, 1) lie on a True pixel of (H, W); on the device of the pixels."""
    height, width = pixels.shape
    columns, rows = (points * torch.tensor([width, height])).long().T.to(pixels.device)
    return pixels[rows, columns]


def prompt(
    sam2: Sam2, encoded: EncodedImage, points: Tensor, options: SegmentsOptions, bounds: Bounds | None = None
) -> list[Candidates]:
    """Prompt SAM2 with points: candidates of each level, in the order of the points, without masks of low
    quality. ``points`` are (P, 2) x, y in [0, 1] of the image's sides; ``bounds`` None stands for those of
    ``options.min_area``."""
    bounds, limits = bounds or Bounds(options.min_area), options.mask_filter
    decoder = PointDecoder(sam2, encoded)
    on_cpu = sam2.compute.device.type == "cpu"
    size = max(1, _PIXELS_A_BATCH_ON_CPU // len(decoder.image)) if on_cpu else _POINTS_A_BATCH
    batches = []
    for batch in points.split(size):
        attended = decoder.attend(batch)
        # Indices, because each selection by a mask would make the CPU wait for a GPU.
        attended = attended.take((attended.ious > limits.pred_iou_thresh).any(1).nonzero()[:, 0])
        levels = zip(decoder.logits(attended).unbind(1), attended.ious.unbind(1), strict=True)
        batches.append([_good_masks(logits.float(), ious.float(), limits, bounds) for logits, ious in levels])
    return [join(level) for level in zip(*batches, strict=True)]


def _good_masks(logits: Tensor, ious: Tensor, limits: MaskFilter, bounds: Bounds) -> Candidates:
    """The masks of one level that have a good quality and are within the bounds."""
    stable = stability_score(logits, limits.stability_score_offset)
    good = (ious > limits.pred_iou_thresh) & (stable >= limits.stability_score_thresh)
    good &= within(logits > 0, bounds)
    return Candidates(logits, ious, stable).take(good.nonzero()[:, 0])


def within(masks: Tensor, bounds: Bounds) -> Tensor:
    """(N,) bool, which (N, M, M) bool masks are within the bounds."""
    # Areas are compared on the small masks, relative to their size.
    cells, count = areas(masks), masks.shape[-2:].numel()
    fit = (cells >= max(1.0, bounds.least * count)) & (cells <= bounds.most * count)
    return fit if bounds.border is None else fit & ~(masks & bounds.border).flatten(1).any(1)

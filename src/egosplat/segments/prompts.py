"""Prompt SAM2 with a grid of points, and filter the masks of each level."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.models.image_encoder import EncodedImage
from egosplat.models.point_decoder import Attended, PointDecoder
from egosplat.models.sam2_loader import Sam2
from egosplat.segments.nms import areas, box_nms, intersections, mask_iou, mask_nms, stability_score
from egosplat.segments.options import LEVELS, MaskFilter, SegmentsOptions

# Points per call of the mask decoder: as in SAM2's automatic mask generator; on a CPU, as many as have this many pixels of
# features together. Larger batches leave its caches, smaller ones have too few rows for a product of matrices.
_POINTS_A_BATCH, _PIXELS_A_BATCH_ON_CPU = 64, 8192

# Distance of the pixels of features whose cells tell whether a mask is too large [pixels].
_SAMPLE_STRIDE = 4


@dataclass(frozen=True)
class Candidates:
    """Candidate masks of one level.

    Attributes:
        logits: (N, M, M) float32, at the size of the model's masks.
        predicted_iou, stability: (N,) float32.
    """

    logits: Tensor
    predicted_iou: Tensor
    stability: Tensor

    def __len__(self) -> int:
        return len(self.logits)

    @property
    def masks(self) -> Tensor:
        """(N, M, M) bool."""
        return self.logits > 0

    @property
    def scores(self) -> Tensor:
        """(N,) predicted IoU times stability score, by which LangSplat ranks masks."""
        return self.predicted_iou * self.stability

    def take(self, chosen: Tensor) -> "Candidates":
        """Select candidates by (K,) indices or a (N,) bool mask."""
        return Candidates(self.logits[chosen], self.predicted_iou[chosen], self.stability[chosen])


@dataclass(frozen=True)
class Bounds:
    """Which masks of an image are used, apart from their quality.

    Attributes:
        least, most: smallest and largest share of the image that they cover.
        border: (M, M) bool, the cells that no mask may cover; None for none.
    """

    least: float
    most: float = 1.0
    border: Tensor | None = None


def prompted_frames(frames: NDArray[np.intp], options: SegmentsOptions) -> list[int]:
    """Every ``key_frame_stride``-th of the frames that may be prompted."""
    return frames[:: options.key_frame_stride].tolist()


def grid_points(points_per_side: int) -> Tensor:
    """(P, 2) float32 x, y in [0, 1], relative to the image's sides: the cell centers of a square grid, row by row."""
    steps = (torch.arange(points_per_side) + 0.5) / points_per_side
    return torch.cartesian_prod(steps, steps).flip(1).contiguous()


def lie_in(points: Tensor, pixels: Tensor) -> Tensor:
    """(P,) bool, which (P, 2) points x, y in [0, 1) lie on a True pixel of (H, W); on the device of the pixels."""
    height, width = pixels.shape
    columns, rows = (points * torch.tensor([width, height])).long().T.to(pixels.device)
    return pixels[rows, columns]


def join(parts: list[Candidates]) -> Candidates:
    """Concatenate candidates whose logits have the same size."""
    return Candidates(
        torch.cat([one.logits for one in parts]),
        torch.cat([one.predicted_iou for one in parts]),
        torch.cat([one.stability for one in parts]),
    )


def prompt(
    sam2: Sam2, encoded: EncodedImage, points: Tensor, options: SegmentsOptions, bounds: Bounds | None = None
) -> list[Candidates]:
    """Prompt SAM2 with points: candidates of each level, in the order of the points, without masks of low quality.

    Args:
        points: (P, 2) x, y in [0, 1], relative to the image's sides.
        bounds: which masks are used; None for those of ``options.min_area``.
    """
    bounds, limits = bounds or Bounds(options.min_area), options.mask_filter
    decoder = PointDecoder.of(sam2, encoded)
    on_cpu = sam2.compute.device.type == "cpu"
    size = max(1, _PIXELS_A_BATCH_ON_CPU // len(decoder.image)) if on_cpu else _POINTS_A_BATCH
    sample = None if bounds.border is None else _Sample.of(decoder, bounds.border)
    batches = []
    for batch in points.split(size):
        attended = decoder.attend(batch)
        possible = attended.ious > limits.pred_iou_thresh
        if sample is not None:
            possible &= ~sample.exceeds(attended, bounds)
        # Indices, because each selection by a mask would make the CPU wait for a GPU.
        attended = attended.take(possible.any(1).nonzero()[:, 0])
        batches.append(_good_masks(decoder.logits(attended), attended.ious, limits, bounds))
    return [
        Candidates(*(torch.cat([batch[name][level] for batch in batches]) for name in range(3)))
        for level in range(len(LEVELS))
    ]


@dataclass(frozen=True)
class _Sample:
    """Some pixels whose cells alone show that most masks are outside of bounds, in a fraction of the time of all cells.

    Attributes:
        pixels: (K,) indices of pixels of features.
        border: (B,) indices of those of their K * 16 cells that no mask may cover.
    """

    decoder: PointDecoder
    pixels: Tensor
    border: Tensor

    @staticmethod
    def of(decoder: PointDecoder, border: Tensor) -> "_Sample":
        """Take the pixels of a border of (M, M) cells, and each fourth of all in both directions."""
        taken, step = border.clone(), 4 * _SAMPLE_STRIDE
        taken[step // 2 :: step, step // 2 :: step] = True
        pixels = decoder.by_part(taken).any(1).nonzero()[:, 0]
        return _Sample(decoder, pixels, decoder.by_part(border)[pixels].flatten().nonzero()[:, 0])

    def exceeds(self, attended: Attended, bounds: Bounds) -> Tensor:
        """(P, 3) bool: which masks cover too many of these cells, or one at the border."""
        masks = self.decoder.parts(attended, self.pixels).flatten(2) > 0
        large = areas(masks.flatten(0, 1)) > bounds.most * self.decoder.cells.numel()
        return large.view(masks.shape[:2]) | masks[..., self.border].any(2)


def _good_masks(
    logits: Tensor, ious: Tensor, limits: MaskFilter, bounds: Bounds
) -> tuple[list[Tensor], list[Tensor], list[Tensor]]:
    """Logits, predicted IoU and stability of each level's masks of good quality, within the bounds."""
    kept: tuple[list[Tensor], list[Tensor], list[Tensor]] = ([], [], [])
    for level in range(len(LEVELS)):
        mask, iou = logits[:, level].float(), ious[:, level].float()
        stable = stability_score(mask, limits.stability_score_offset)
        fit = _within(mask > 0, bounds)
        good = (iou > limits.pred_iou_thresh) & (stable >= limits.stability_score_thresh) & fit
        for values, each in zip(kept, (mask, iou, stable), strict=True):
            values.append(each[good.nonzero()[:, 0]])
    return kept


def _within(masks: Tensor, bounds: Bounds) -> Tensor:
    """(N,) which of (N, M, M) bool masks are within the bounds."""
    # Areas are compared on the small masks, relative to their size.
    cells, count = areas(masks), masks.shape[-2:].numel()
    fit = (cells >= max(1.0, bounds.least * count)) & (cells <= bounds.most * count)
    return fit if bounds.border is None else fit & ~(masks & bounds.border).flatten(1).any(1)


def filter_masks(found: Candidates, options: SegmentsOptions) -> Candidates:
    """Drop redundant masks: NMS of boxes, then LangSplat's mask NMS (docs/method.md#mask-filters)."""
    if len(found) == 0:
        return found
    # SAM's generator removes boxes first; LangSplat applies its mask NMS to what remains.
    limits = options.mask_filter
    found = found.take(box_nms(found.masks, found.predicted_iou, limits.box_nms_thresh))
    kept = mask_nms(
        found.masks,
        found.scores,
        iou_thresh=limits.nms_iou_thresh,
        score_thresh=limits.nms_score_thresh,
        inner_thresh=limits.nms_inner_thresh,
    )
    return found.take(kept)


def drop_covered(found: Candidates, others: Tensor, cover_thresh: float, iou_thresh: float) -> Candidates:
    """Drop candidates that (K, M, M) bool masks of the same level show already.

    Args:
        cover_thresh: drop candidates of which the others together cover a larger share; 1 for none.
        iou_thresh: drop candidates whose IoU with any other mask is larger.
    """
    if len(found) == 0 or len(others) == 0:
        return found
    # Two criteria: parts of a tracked object are covered by it, and a larger version of it overlaps it.
    covered = intersections(found.masks, others.any(0)[None])[:, 0] / areas(found.masks).clamp(min=1.0)
    repeats = mask_iou(found.masks, others).amax(1) > iou_thresh
    return found.take((covered <= cover_thresh) & ~repeats)

"""Overlap of masks, and non-maximum suppression by boxes and by masks (docs/method.md#mask-filters)."""

import torch
from torch import Tensor

from egosplat.models.without_compiler import without_compiler

with without_compiler():
    import torchvision


def intersections(first: Tensor, second: Tensor) -> Tensor:
    """(N, H, W) and (M, H, W) bool masks -> (N, M) float32 number of shared pixels; exact up to 2^24."""
    # Autocast would multiply in bfloat16, which rounds counts above 256.
    with torch.autocast(first.device.type, enabled=False):
        return first.flatten(1).float() @ second.flatten(1).float().T


def areas(masks: Tensor) -> Tensor:
    """(N, H, W) bool masks -> (N,) float32 pixels."""
    # The sum of a bool tensor takes up to twenty times as long.
    return masks.flatten(1).view(torch.uint8).sum(1, dtype=torch.int32).float()


def union(masks: Tensor) -> Tensor:
    """(K, M, M) bool masks -> (M, M) bool union; empty if K is 0."""
    return masks.any(0) if len(masks) else torch.zeros(masks.shape[1:], dtype=torch.bool, device=masks.device)


def mask_iou(first: Tensor, second: Tensor) -> Tensor:
    """(N, H, W) and (M, H, W) bool masks -> (N, M) IoU; 0 where both are empty."""
    shared = intersections(first, second)
    union = areas(first)[:, None] + areas(second)[None] - shared
    return shared / union.clamp(min=1.0)


def stability_score(logits: Tensor, offset: float) -> Tensor:
    """(N, H, W) logits -> (N,) IoU of the mask cut at ``offset`` with that cut at ``-offset``; 0 if both are empty."""
    high, low = (areas(logits > cut) for cut in (offset, -offset))
    return high / low.clamp(min=1.0)


def boxes(masks: Tensor) -> Tensor:
    """(N, H, W) bool masks -> (N, 4) float32 x0, y0, x1, y1 [px], ends exclusive; zeros of an empty mask."""
    if len(masks) == 0:
        return torch.zeros(0, 4, device=masks.device)
    # The largest value of bytes takes a tenth of the time of ``any``.
    shown = masks.view(torch.uint8)
    rows, columns = shown.amax(2), shown.amax(1)
    (top, bottom), (left, right) = _spans(rows), _spans(columns)
    return torch.stack([left, top, right, bottom], dim=1).float() * rows.amax(1)[:, None]


def _spans(shown: Tensor) -> tuple[Tensor, Tensor]:
    """(N, M) uint8 -> (N,) place of the first 1 of each row, and of the last one plus 1."""
    return shown.argmax(1), shown.shape[1] - shown.flip(1).argmax(1)


def box_nms(masks: Tensor, scores: Tensor, thresh: float) -> Tensor:
    """Indices, best score first, of masks whose boxes overlap no better mask's box by more than ``thresh`` IoU."""
    # On the CPU, so that no device orders boxes of equal scores in another way.
    return torchvision.ops.nms(boxes(masks).cpu(), scores.cpu(), thresh).to(masks.device)


def mask_nms(
    masks: Tensor, scores: Tensor, *, iou_thresh: float, score_thresh: float, inner_thresh: float
) -> Tensor:
    """Filter redundant masks by LangSplat's rules.

    A mask is dropped if

    - its score is not above ``score_thresh``; or
    - a mask of higher score (the earlier of equal ones) overlaps it by more than ``iou_thresh`` IoU; or
    - it lies inside another mask: the intersection is a share A < 0.5 of the outer mask and B >= 0.85 of the
      inner one, and 1 - AB > 1 - ``inner_thresh``.

    Args:
        masks: (N, H, W) bool.
        scores: (N,) predicted IoU times stability score.

    Returns:
        (N,) bool: which are kept.
    """
    # All pairs count, as in LangSplat: a mask that is dropped itself still drops others.
    shared, sizes = intersections(masks, masks), areas(masks).clamp(min=1.0)
    iou = shared / (sizes[:, None] + sizes[None] - shared).clamp(min=1.0)
    order = torch.arange(len(masks), device=masks.device)
    better = (scores[:, None] > scores[None]) | (
        (scores[:, None] == scores[None]) & (order[:, None] < order[None])
    )
    repeated = (better & (iou > iou_thresh)).any(0)
    # [i, j]: i is the outer mask, j the inner one.
    of_outer, of_inner = shared / sizes[:, None], shared / sizes[None]
    # 0.5 and 0.85 are fixed in LangSplat's code (docs/method.md#nested-masks).
    nested = (of_outer < 0.5) & (of_inner >= 0.85) & (1 - of_outer * of_inner > 1 - inner_thresh)
    return (scores > score_thresh) & ~repeated & ~nested.any(0)

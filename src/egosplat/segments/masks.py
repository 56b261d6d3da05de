"""Candidate masks of a frame: their overlaps, the filters that drop redundant ones, and the label map they give."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from egosplat.arrays import Bools, Ints32
from egosplat.models.without_compiler import without_compiler
from egosplat.segments.options import MaskFilter

with without_compiler():
    import torchvision


@dataclass(frozen=True)
class Candidates:
    """N candidate masks of one level: (N, M, M) float32 logits at the size of the model's masks, and (N,) float32 scores."""

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


def join(candidates: Sequence[Candidates]) -> Candidates:
    """Concatenate candidates whose logits have the same size."""
    return Candidates(*map(torch.cat, zip(*(vars(one).values() for one in candidates), strict=True)))


def intersections(first: Tensor, second: Tensor) -> Tensor:
    """(N, H, W) and (M, H, W) bool masks -> (N, M) float32 number of shared pixels; exact up to 2^24."""
    # Autocast would multiply in bfloat16, which rounds counts above 256.
    with torch.autocast(first.device.type, enabled=False):
        rows = first.flatten(1).float()
        return rows @ (rows if second is first else second.flatten(1).float()).T


def areas(masks: Tensor) -> Tensor:
    """(N, H, W) bool masks -> (N,) float32 pixels."""
    # The sum of a bool tensor takes up to twenty times as long.
    return masks.flatten(1).view(torch.uint8).sum(1, dtype=torch.int32).float()


def mask_iou(first: Tensor, second: Tensor) -> Tensor:
    """(N, H, W) and (M, H, W) bool masks -> (N, M) IoU; 0 where both are empty."""
    shared = intersections(first, second)
    return shared / (areas(first)[:, None] + areas(second)[None] - shared).clamp(min=1.0)


def stability_score(logits: Tensor, offset: float) -> Tensor:
    """(N, H, W) logits -> (N,) IoU of the mask cut at ``offset`` with that cut at ``-offset``; 0 if both are empty."""
    return areas(logits > offset) / areas(logits > -offset).clamp(min=1.0)


def boxes(masks: Tensor) -> Tensor:
    """(N, H, W) bool masks -> (N, 4) float32 x0, y0, x1, y1 [px], ends exclusive; zeros of an empty mask."""
    # The largest value of bytes takes a tenth of the time of ``any``.
    rows, columns = masks.view(torch.uint8).amax(2), masks.view(torch.uint8).amax(1)
    starts = [shown.argmax(1) for shown in (columns, rows)]
    ends = [shown.shape[1] - shown.flip(1).argmax(1) for shown in (columns, rows)]
    return torch.stack([*starts, *ends], dim=1).float() * rows.amax(1)[:, None]


def box_nms(masks: Tensor, scores: Tensor, thresh: float) -> Tensor:
    """Indices, best score first, of masks whose boxes overlap no better mask's box by more than ``thresh`` IoU."""
    # On the CPU, so that no device orders boxes of equal scores in another way.
    return torchvision.ops.nms(boxes(masks).cpu(), scores.cpu(), thresh).to(masks.device)


def mask_nms(masks: Tensor, scores: Tensor, limits: MaskFilter) -> Tensor:
    """(N,) bool, which of (N, H, W) bool masks with (N,) scores LangSplat's rules keep. A mask is dropped if
    its score is not above ``nms_score_thresh``; or if a mask of higher score (the earlier of equal ones)
    overlaps it by more than ``nms_iou_thresh`` IoU; or if it lies inside another mask: the intersection is a
    share A < 0.5 of the outer mask and B >= 0.85 of the inner one, and 1 - AB > 1 - ``nms_inner_thresh``."""
    # All pairs count, as in LangSplat: a mask that is dropped itself still drops others.
    shared, sizes = intersections(masks, masks), areas(masks).clamp(min=1.0)
    iou = shared / (sizes[:, None] + sizes[None] - shared).clamp(min=1.0)
    order = torch.arange(len(masks), device=masks.device)
    better = (scores[:, None] > scores[None]) | (
        (scores[:, None] == scores[None]) & (order[:, None] < order[None])
    )
    repeated = (better & (iou > limits.nms_iou_thresh)).any(0)
    # [i, j]: i is the outer mask, j the inner one.
    of_outer, of_inner = shared / sizes[:, None], shared / sizes[None]
    # 0.5 and 0.85 are fixed in LangSplat's code (docs/method.md#nested-masks).
    nested = (of_outer < 0.5) & (of_inner >= 0.85) & (1 - of_outer * of_inner > 1 - limits.nms_inner_thresh)
    return (scores > limits.nms_score_thresh) & ~repeated & ~nested.any(0)


def filter_masks(found: Candidates, limits: MaskFilter) -> Candidates:
    """Drop redundant masks: NMS of boxes, then LangSplat's mask NMS (docs/method.md#mask-filters)."""
    # SAM's generator removes boxes first; LangSplat applies its mask NMS to what remains.
    found = found.take(box_nms(found.masks, found.predicted_iou, limits.box_nms_thresh))
    return found.take(mask_nms(found.masks, found.scores, limits))


def drop_covered(found: Candidates, others: Tensor, cover_thresh: float, iou_thresh: float) -> Candidates:
    """Drop candidates of which (K, M, M) bool masks of the same level together cover a larger share than
    ``cover_thresh``. And those whose IoU with any of them is larger than ``iou_thresh``."""
    # Two criteria: parts of a tracked object are covered by it, and a larger version of it overlaps it.
    covered = intersections(found.masks, others.any(0)[None])[:, 0] / areas(found.masks).clamp(min=1.0)
    repeats = (mask_iou(found.masks, others) > iou_thresh).any(1)
    return found.take((covered <= cover_thresh) & ~repeats)


def paint(ids: Sequence[int], logits: Tensor, shown: Bools) -> Ints32:
    """(H, W) int32 object of the highest of (K, M, M) logits above 0; -1 for none, and where not (H, W) ``shown``."""
    device = logits.device
    best = torch.zeros(shown.shape, device=device)
    labels = torch.full(shown.shape, -1, dtype=torch.int32, device=device)
    for number, one in zip(ids, logits, strict=True):
        # Most tracked objects are absent from a frame: enlarged, they would paint nothing. A GPU would have to wait.
        if device.type == "cpu" and one.max() <= 0:
            continue
        enlarged = F.interpolate(one[None, None], shown.shape, mode="bilinear", align_corners=False)[0, 0]
        labels.masked_fill_(enlarged > best, number)  # the first wins ties
        best = torch.maximum(best, enlarged)
    labels[torch.from_numpy(~shown).to(device)] = -1
    return labels.cpu().numpy()

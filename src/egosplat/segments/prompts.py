"""Prompt SAM2 with a grid of points, and filter the masks of each level."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.models.image_encoder import EncodedImage
from egosplat.models.point_decoder import PointDecoder
from egosplat.models.sam2_loader import Sam2
from egosplat.segments.nms import areas, box_nms, intersections, mask_iou, mask_nms, stability_score
from egosplat.segments.options import LEVELS, SegmentsOptions

# Points per call of the mask decoder: as in SAM2's automatic mask generator; on a CPU, where larger batches take up to
# twice the time, because the system has to find memory for them each time.
_POINTS_A_BATCH, _POINTS_A_BATCH_ON_CPU = 64, 8


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
    sam2: Sam2, encoded: EncodedImage, points: Tensor, options: SegmentsOptions, frame_share: float = 1.0
) -> list[Candidates]:
    """Prompt SAM2 with points: candidates of each level, in the order of the points, without masks of low quality.

    Args:
        points: (P, 2) x, y in [0, 1], relative to the image's sides.
        frame_share: share of the frame that the image covers.
    """
    min_area = options.min_area / frame_share
    size = _POINTS_A_BATCH_ON_CPU if sam2.compute.device.type == "cpu" else _POINTS_A_BATCH
    decoder = PointDecoder.of(sam2, encoded)
    batches = [_good_masks(*decoder.decode(batch), options, min_area) for batch in points.split(size)]
    return [
        Candidates(*(torch.cat([batch[name][level] for batch in batches]) for name in range(3)))
        for level in range(len(LEVELS))
    ]


def _good_masks(
    logits: Tensor, ious: Tensor, options: SegmentsOptions, min_area: float
) -> tuple[list[Tensor], list[Tensor], list[Tensor]]:
    """Logits, predicted IoU and stability of each level's masks of good quality, and at least a share of the image large."""
    kept: tuple[list[Tensor], list[Tensor], list[Tensor]] = ([], [], [])
    limits = options.mask_filter
    for level in range(len(LEVELS)):
        mask, iou = logits[:, level].float(), ious[:, level].float()
        stable = stability_score(mask, limits.stability_score_offset)
        # Areas are compared on the small masks, relative to their size.
        large = areas(mask > 0) >= max(1.0, min_area * mask.shape[-2:].numel())
        # Indices, because each selection by a mask would make the CPU wait for a GPU.
        good = ((iou > limits.pred_iou_thresh) & (stable >= limits.stability_score_thresh) & large).nonzero()[
            :, 0
        ]
        for values, each in zip(kept, (mask, iou, stable), strict=True):
            values.append(each[good])
    return kept


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


def drop_covered(found: Candidates, tracked: Tensor, cover_thresh: float, iou_thresh: float) -> Candidates:
    """Drop masks of objects that are tracked already.

    Args:
        found: candidates of a level.
        tracked: (K, M, M) bool masks of the level's instances in this image.
        cover_thresh: drop masks whose share of covered pixels is larger.
        iou_thresh: drop masks whose IoU with any instance is larger.
    """
    if len(found) == 0 or len(tracked) == 0:
        return found
    # Two criteria: parts of a tracked object are covered by it, and a larger version of it overlaps it.
    covered = intersections(found.masks, tracked.any(0)[None])[:, 0] / areas(found.masks).clamp(min=1.0)
    repeats = mask_iou(found.masks, tracked).amax(1) > iou_thresh
    return found.take((covered <= cover_thresh) & ~repeats)


def drop_repeated(found: Candidates, others: Tensor, iou_thresh: float) -> Candidates:
    """Drop candidates whose IoU with one of the (K, M, M) bool masks is larger than ``iou_thresh``."""
    if len(found) == 0 or len(others) == 0:
        return found
    return found.take(mask_iou(found.masks, others).amax(1) <= iou_thresh)


def match_masks(masks: Tensor, others: Tensor, least_iou: float) -> Tensor:
    """(N, M, M) and (K, M, M) bool masks -> (N,) int64 index of the best match by IoU; -1 below ``least_iou``."""
    if len(masks) == 0 or len(others) == 0:
        return torch.full((len(masks),), -1, dtype=torch.int64, device=masks.device)
    iou, place = mask_iou(masks, others).max(1)
    return torch.where(iou >= least_iou, place, -1)

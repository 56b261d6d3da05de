"""SAM2's video predictor, with the same results with and without SAM2's compiled extension."""

from functools import cache
from typing import Any

import cv2
import numpy as np
import torch
from sam2.sam2_video_predictor import SAM2VideoPredictor
from torch import Tensor

# Score of a filled pixel: just inside the mask, as in SAM2.
FILLED = 0.1


def fill_holes(scores: Tensor, max_area: int) -> Tensor:
    """Fill holes of masks, 8-connected components outside of them up to an area [px], in their (..., H, W) scores above 0
    inside.

    SAM2 does this in its compiled extension, and skips it with a warning if that is missing.
    """
    outside = (scores <= 0).to("cpu", torch.uint8).reshape(-1, *scores.shape[-2:]).numpy()
    holes = np.zeros(outside.shape, bool)
    for mask, hole in zip(outside, holes, strict=True):
        _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
        small = np.asarray(stats)[:, cv2.CC_STAT_AREA] <= max_area
        small[0] = False  # label 0 is the mask itself
        hole[:] = small[np.asarray(labels, np.int32)]
    filled = torch.from_numpy(holes).reshape(scores.shape).to(scores.device)
    return torch.where(filled, torch.as_tensor(FILLED, dtype=scores.dtype, device=scores.device), scores)


class VideoPredictor(SAM2VideoPredictor):
    """``SAM2VideoPredictor`` that fills holes by ``fill_holes``, and computes once what objects or pictures share."""

    def __init__(self, fill_hole_area: int, **arguments: Any) -> None:
        super().__init__(fill_hole_area=0, **arguments)
        self.hole_area = fill_hole_area
        first, trunk = self.memory_attention.layers[0], self.image_encoder.trunk
        trunk._get_pos_embed, attend = cache(trunk._get_pos_embed), first._forward_sa
        last: list[Tensor] = []

        def attend_once(pictures: Tensor, positions: Tensor) -> Tensor:
            # All objects of a frame see the same picture, in the next calls, too.
            if not (last and torch.equal(last[0], pictures[:1])):
                last[:] = pictures[:1], attend(pictures[:1], positions[:1])
            return last[1].expand_as(pictures)

        first._forward_sa = attend_once

    def _run_single_frame_inference(self, *arguments: Any, **named: Any) -> tuple[dict[str, Any], Tensor]:
        output, masks = super()._run_single_frame_inference(*arguments, **named)
        masks = fill_holes(masks, self.hole_area)
        return output | {"pred_masks": masks.to(output["pred_masks"].device)}, masks

"""Small holes in masks."""

import cv2
import numpy as np
import torch
from torch import Tensor

FILLED = 0.1
"""Score of a pixel that is filled: just inside, as in SAM2."""


def fill_holes(scores: Tensor, max_area: int) -> Tensor:
    """Fill the holes of masks: parts of the outside, connected over eight neighbours, of at most some pixels.

    What SAM2 does by its compiled extension, and leaves out, with a warning, where that is absent; here it is
    done everywhere.

    Args:
        scores: (..., H, W) floating-point scores, above 0 inside.
        max_area: the largest hole that is filled [px].

    Returns:
        Scores of the same shape, type and device.
    """
    outside = (scores <= 0).to("cpu", torch.uint8).reshape(-1, *scores.shape[-2:]).numpy()
    holes = np.stack([_small_parts(mask, max_area) for mask in outside]) if len(outside) else outside > 0
    filled = torch.from_numpy(holes).reshape(scores.shape).to(scores.device)
    return torch.where(filled, torch.as_tensor(FILLED, dtype=scores.dtype, device=scores.device), scores)


def _small_parts(mask: np.ndarray, max_area: int) -> np.ndarray:
    _, labels, facts, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    small = facts[:, cv2.CC_STAT_AREA] <= max_area
    small[0] = False  # label 0 is what is not outside
    return small[labels]

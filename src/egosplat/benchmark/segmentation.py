"""How well masks cover what is asked for (M2.4)."""

import numpy as np
from numpy.typing import NDArray

from egosplat.benchmark.queries import Mask


def iou(predicted: Mask, truth: Mask, valid: Mask | None) -> float:
    """Intersection over union of two masks, 0..1.

    Args:
        predicted, truth: (H, W) bool; the truth is seen in a valid pixel at least.
        valid: (H, W) bool pixels that count, or None for all.

    Raises:
        ValueError: shapes differ, or there is no truth: then the value is not defined.
    """
    if predicted.shape != truth.shape:
        raise ValueError(f"a mask of {predicted.shape} is compared with one of {truth.shape}")
    if valid is not None:
        predicted, truth = predicted & valid, truth & valid
    if not truth.any():
        raise ValueError("a query without a visible instance has no IoU")
    return float((predicted & truth).sum() / (predicted | truth).sum())


def mean_iou(ious: NDArray[np.float64]) -> float:
    """Plain mean over (P,) pairs of frame and category, as LangSplat's (M7 no. 37); NaN of none."""
    return float(ious.mean()) if len(ious) else float("nan")

"""How well masks cover what is asked for: LangSplat's IoU."""

from egosplat.evaluation.queries import Mask


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

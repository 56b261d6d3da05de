"""IoU of masks: of point prompts by size, and of tracked masks. A score is a row with name, class and value."""

import numpy as np
from numpy.typing import NDArray

from benchmarks.small_sam2.segmenters import Segmenter
from benchmarks.small_sam2.worlds import LEAST_PIXELS, LEVELS, Film, Masks, Still, comes_back, size_class

Row = tuple[str, str, float]


def iou(first: Masks, second: Masks) -> NDArray[np.float64]:
    """(..., H, W) and (..., H, W) masks, broadcast -> (...,) IoU; 1 for two empty masks."""
    overlap, union = (first & second).sum((-2, -1)), (first | second).sum((-2, -1))
    return np.where(union > 0, overlap / np.maximum(union, 1), 1.0)


def score_points(segmenter: Segmenter, still: Still) -> list[Row]:
    """For each point, the best of three masks, and the mask of the prompted level."""
    ious = iou(segmenter.point(still), still.masks[:, None])
    rows = []
    for number, level in enumerate(still.levels):
        kind = size_class(still.masks[number])
        rows.append((f"best of three, {LEVELS[level]}", kind, float(ious[number].max())))
        rows.append((f"own level, {LEVELS[level]}", kind, float(ious[number, level])))
    return rows


def score_film(segmenter: Segmenter, film: Film) -> list[Row]:
    """J: mean IoU over the later frames in which a mask is visible, and the silence while it is hidden."""
    tracked = segmenter.track(film)
    visible = film.masks.sum((2, 3)) >= LEAST_PIXELS
    ious = iou(tracked, film.masks)
    rows = []
    for number in range(len(film.masks)):
        later = np.flatnonzero(visible[number, 1:]) + 1
        if len(later):
            kind = "returns" if comes_back(visible[number]) else "stays or goes"
            rows.append(("J", kind, float(ious[number, later].mean())))
        gone = np.flatnonzero(~visible[number])
        if len(gone):
            silent = tracked[number, gone].sum((1, 2)) < LEAST_PIXELS
            rows.append(("silent while hidden", "all", float(silent.mean())))
    return rows

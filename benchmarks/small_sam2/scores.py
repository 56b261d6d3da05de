"""How right masks are: of points by size, of everything found, of masks followed."""

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from benchmarks.small_sam2.segmenters import Segmenter
from benchmarks.small_sam2.worlds import (
    LEAST_PIXELS,
    LEVELS,
    SIZES,
    Film,
    Masks,
    Picture,
    comes_back,
    size_class,
)


def iou(first: Masks, second: Masks) -> NDArray[np.float64]:
    """(..., H, W) and (..., H, W) masks, broadcast -> (...,) IoU; of two empty ones 1."""
    overlap, union = (first & second).sum((-2, -1)), (first | second).sum((-2, -1))
    return np.where(union > 0, overlap / np.maximum(union, 1), 1.0)


@dataclass
class Scores:
    """Single results, by name and class; ``mean`` takes them together."""

    values: dict[tuple[str, str], list[float]] = field(default_factory=lambda: defaultdict(list))
    predicted: list[float] = field(default_factory=list)
    true: list[float] = field(default_factory=list)

    def add(self, name: str, kind: str, value: float) -> None:
        """One more result."""
        self.values[name, kind].append(float(value))

    def extend(self, other: "Scores") -> None:
        """All results of another."""
        for key, values in other.values.items():
            self.values[key] += values
        self.predicted += other.predicted
        self.true += other.true

    def mean(self, name: str, kinds: list[str]) -> tuple[float, int]:
        """Mean over some classes and how many results it is of; NaN of none."""
        found = [value for kind in kinds for value in self.values.get((name, kind), [])]
        return (float(np.mean(found)) if found else float("nan")), len(found)

    def rank_correlation(self) -> float:
        """Spearman's, of predicted with true IoU; NaN where nothing was predicted."""
        return float(spearmanr(self.predicted, self.true).statistic) if self.predicted else float("nan")


def score_points(segmenter: Segmenter, picture: Picture, scores: Scores) -> None:
    """Best of three masks, and the mask of the asked level, for each point."""
    answer = segmenter.point(picture)
    ious = iou(answer.masks, picture.masks[:, None])
    for number, level in enumerate(picture.levels):
        kind = size_class(picture.masks[number])
        scores.add(f"best of three, {LEVELS[level]}", kind, ious[number].max())
        scores.add(f"own level, {LEVELS[level]}", kind, ious[number, level])
    if answer.ious is not None:
        own = np.arange(len(picture.levels)), picture.levels
        scores.predicted += answer.ious[own].tolist()
        scores.true += ious[own].tolist()


def score_everything(segmenter: Segmenter, picture: Picture, scores: Scores) -> None:
    """For each whole the best of all masks that were found without being asked."""
    found = segmenter.everything(picture)
    scores.add("masks found", "all", len(found))
    for whole in picture.wholes:
        best = iou(found, whole).max() if len(found) else 0.0
        scores.add("everything", size_class(whole), best)


def score_film(segmenter: Segmenter, film: Film, scores: Scores) -> None:
    """J: mean IoU over the later frames in which a mask is visible; apart, for those that come back."""
    followed = segmenter.follow(film)
    visible = film.masks.sum((2, 3)) >= LEAST_PIXELS
    ious = iou(followed, film.masks)
    for number in range(len(film.masks)):
        later = np.flatnonzero(visible[number, 1:]) + 1
        kind = "hidden for a while" if comes_back(visible[number]) else "always visible or gone for good"
        if len(later):
            scores.add("J", kind, ious[number, later].mean())
        gone = np.flatnonzero(~visible[number])
        if len(gone):
            scores.add(
                "silent while hidden", "all", (followed[number, gone].sum((1, 2)) < LEAST_PIXELS).mean()
            )


LARGE = [name for name, least in SIZES.items() if least >= 0.01]
"""The classes above 1 % of the picture."""

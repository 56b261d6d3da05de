"""How well masks cover what moves, and nothing else."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LEAST_SHARE = 0.001
"""Of the picture, that a moving instance covers in a frame to be missed there."""

_COVERED = 0.5
"""Share of it that a mask covers, not to miss it."""

Mask = NDArray[np.bool_]


@dataclass
class MaskScores:
    """Counts over the frames of a recording.

    Attributes:
        hit, predicted, true: pixels that are masked and move, that are masked, that move.
        seen, missed: moving instances in frames that show enough of them, and those of which less than half is
            masked.
    """

    hit: int = 0
    predicted: int = 0
    true: int = 0
    pixels: int = 0
    seen: int = 0
    missed: int = 0

    def add(self, mask: Mask, labels: NDArray[np.int32], moves: Mask, valid: Mask) -> None:
        """Take in one frame.

        Args:
            mask: (H, W) what is masked; labels: (H, W) true instances; moves: (N,); valid: (H, W).
        """
        truth = np.append(moves, False)[labels] & valid
        masked = mask & valid
        self.hit += int((masked & truth).sum())
        self.predicted += int(masked.sum())
        self.true += int(truth.sum())
        self.pixels += int(valid.sum())
        area = np.bincount(labels[truth], minlength=len(moves))
        covered = np.bincount(labels[truth & masked], minlength=len(moves))
        large = area >= LEAST_SHARE * labels.size
        self.seen += int(large.sum())
        self.missed += int((covered[large] < _COVERED * area[large]).sum())

    @property
    def iou(self) -> float:
        """1 where nothing moves and nothing is masked."""
        union = self.predicted + self.true - self.hit
        return self.hit / union if union else 1.0

    @property
    def precision(self) -> float:
        """NaN where nothing is masked."""
        return self.hit / self.predicted if self.predicted else float("nan")

    @property
    def recall(self) -> float:
        """NaN where nothing moves."""
        return self.hit / self.true if self.true else float("nan")

    @property
    def missed_share(self) -> float:
        """Of (moving instance, frame) pairs; NaN where there is none."""
        return self.missed / self.seen if self.seen else float("nan")

    @property
    def still_masked(self) -> float:
        """Share of the still pixels that are masked."""
        return (self.predicted - self.hit) / max(self.pixels - self.true, 1)


def total(scores: Iterable[MaskScores]) -> MaskScores:
    """All counts together."""
    everything = MaskScores()
    for one in scores:
        for name in ("hit", "predicted", "true", "pixels", "seen", "missed"):
            setattr(everything, name, getattr(everything, name) + getattr(one, name))
    return everything

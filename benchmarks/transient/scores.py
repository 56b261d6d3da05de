"""Scores of masks: how well they cover moving pixels, and no others."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

# Least share of the frame that a moving instance covers to count as seen there.
LEAST_SHARE = 0.001

# Share of a moving instance that a mask must cover not to miss it.
_COVERED = 0.5

Mask = NDArray[np.bool_]


@dataclass
class MaskScores:
    """Counts over the frames of a recording.

    Attributes:
        hit, predicted, true: pixels that are masked and moving, masked, and moving.
        pixels: valid pixels.
        seen, missed: pairs of a moving instance and a frame that shows enough of it, and pairs of which the mask covers
            less than half.
    """

    hit: int = 0
    predicted: int = 0
    true: int = 0
    pixels: int = 0
    seen: int = 0
    missed: int = 0

    def add(self, mask: Mask, labels: NDArray[np.int32], moves: Mask, valid: Mask) -> None:
        """Add one frame.

        Args:
            mask: (H, W) the mask; labels: (H, W) true instances; moves: (N,) of each; valid: (H, W).
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
        """Share of the seen pairs that are missed; NaN where there is none."""
        return self.missed / self.seen if self.seen else float("nan")

    @property
    def still_masked(self) -> float:
        """Share of the static pixels that are masked."""
        return (self.predicted - self.hit) / max(self.pixels - self.true, 1)


def total(scores: Iterable[MaskScores]) -> MaskScores:
    """The sum of all counts."""
    counts = [asdict(one) for one in scores]
    return MaskScores(**{name: sum(one[name] for one in counts) for name in asdict(MaskScores())})

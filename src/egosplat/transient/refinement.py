"""Spatial-temporal refinement: from pixel probabilities to transient instances."""

import numpy as np
from numpy.typing import NDArray

Scores = NDArray[np.float64]


class InstanceScores:
    """Mean probability of each of N instances over its pixels in all added frames, as in the paper's set D."""

    def __init__(self, count: int) -> None:
        """Start without frames; ``count`` is the number of instances N."""
        self._sums = np.zeros(count)
        self._pixels = np.zeros(count, np.int64)

    def add(self, labels: NDArray[np.int32], probability: NDArray[np.floating]) -> None:
        """Add one frame.

        Args:
            labels: (L, H, W) instance at each level, -1 for none; an instance belongs to one level.
            probability: (H, W) in [0, 1]; a value that is not finite counts as 0.
        """
        weight = np.nan_to_num(probability.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)
        for level in labels:
            seen = level >= 0
            found = level[seen]
            self._pixels += np.bincount(found, minlength=len(self._pixels))
            self._sums += np.bincount(found, weights=weight[seen], minlength=len(self._sums))

    @property
    def pixels(self) -> NDArray[np.int64]:
        """(N,) number of pixels of each instance in the added frames."""
        return self._pixels.copy()

    @property
    def scores(self) -> Scores:
        """(N,) mean probability of each instance; 0 if it has no pixel."""
        # Pooled over pixels, so a large view of an instance has more weight than a small one.
        return np.divide(self._sums, self._pixels, out=np.zeros_like(self._sums), where=self._pixels > 0)


def transient_instances(
    scores: Scores, pixels: NDArray[np.int64], level: NDArray[np.int8], threshold: float, levels: set[int]
) -> NDArray[np.bool_]:
    """(N,) the set D: instances of ``levels`` with at least one pixel and a score of at least ``threshold``."""
    return (scores >= threshold) & (pixels > 0) & np.isin(level, sorted(levels))


def refined_mask(labels: NDArray[np.int32], transient: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(H, W) union of the transient instances in one frame, from (L, H, W) labels and the (N,) set."""
    # Label -1 indexes the appended last entry: pixels without an instance are not transient.
    return np.append(transient, False)[labels].any(axis=0)

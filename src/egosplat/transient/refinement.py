"""From probabilities to instances: the paper's spatial-temporal refinement."""

import numpy as np
from numpy.typing import NDArray

Scores = NDArray[np.float64]


class InstanceScores:
    """Mean probability of each of N instances, pooled over the pixels of all frames that are added, as in the paper's set D.

    A large view of an instance thereby counts for more than a small one.
    """

    def __init__(self, count: int) -> None:
        """``count``: number of instances."""
        self._sums = np.zeros(count)
        self._pixels = np.zeros(count, np.int64)

    def add(self, labels: NDArray[np.int32], probability: NDArray[np.floating]) -> None:
        """Take in one frame.

        Args:
            labels: (L, H, W) instance at each level, -1 for none; an instance is seen at one level only.
            probability: (H, W) in [0, 1]; a pixel where it is not finite counts as 0.
        """
        weight = np.nan_to_num(probability.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)
        for level in labels:
            seen = level >= 0
            found = level[seen]
            self._pixels += np.bincount(found, minlength=len(self._pixels))
            self._sums += np.bincount(found, weights=weight[seen], minlength=len(self._sums))

    @property
    def pixels(self) -> NDArray[np.int64]:
        """(N,) pixels of each instance in the frames that were added."""
        return self._pixels.copy()

    @property
    def scores(self) -> Scores:
        """(N,) mean probability of each instance; 0 where it has no pixel."""
        return np.divide(self._sums, self._pixels, out=np.zeros_like(self._sums), where=self._pixels > 0)


def transient_instances(
    scores: Scores, pixels: NDArray[np.int64], level: NDArray[np.int8], threshold: float, levels: set[int]
) -> NDArray[np.bool_]:
    """(N,) the set D: instances of ``levels`` with a pixel whose score is at or above ``threshold``."""
    return (scores >= threshold) & (pixels > 0) & np.isin(level, sorted(levels))


def refined_mask(labels: NDArray[np.int32], transient: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(H, W) union of the transient instances in one frame, from (L, H, W) labels and the (N,) set."""
    # The last entry is the one that -1 picks: nothing is not transient.
    return np.append(transient, False)[labels].any(axis=0)

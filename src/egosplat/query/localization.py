"""Where what is asked for is most likely (docs/method.md#localization)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.query.smoothing import Map, Mask


@dataclass(frozen=True, eq=False)
class Location:
    """The place of the largest relevancy.

    Attributes:
        level: index of the level at which it is largest, the first of equal ones.
        score: that relevancy, smoothed.
        candidates: (K, 2) int64 column and row of all pixels that have it, K at least 1.
    """

    level: int
    score: float
    candidates: NDArray[np.int64]

    @property
    def pixel(self) -> tuple[int, int]:
        """Column and row of one candidate: that nearest to their middle."""
        apart = np.linalg.norm(self.candidates - self.candidates.mean(axis=0), axis=1)
        column, row = self.candidates[apart.argmin()]
        return int(column), int(row)


def localize(filtered: Map, seen: Mask) -> Location | None:
    """The level with the largest value, and all pixels that have this value.

    Args:
        filtered: (L, H, W) float32 smoothed relevancy, finite.
        seen: (L, H, W) bool; other pixels are no candidates.

    Returns:
        None where nothing is seen at any level.
    """
    if not seen.any():
        return None
    peaks = filtered.max(axis=(1, 2), where=seen, initial=-np.inf)
    level = int(peaks.argmax())
    rows, columns = np.nonzero((filtered[level] == peaks[level]) & seen[level])
    return Location(level, float(peaks[level]), np.stack([columns, rows], axis=1))

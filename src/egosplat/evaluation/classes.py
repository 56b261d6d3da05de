"""Masks of classes, as in 3D-OVS's benchmark: each pixel is of the category of the recording that is most relevant there."""

from collections.abc import Sequence

import numpy as np

from egosplat.evaluation.queries import InstanceMap, Mask, Query, mask_of
from egosplat.frames.recording import Instance
from egosplat.query.maps import Map

# The value of ``metrics.masks`` that takes these masks.
CLASSES = "classes"


class ClassMap:
    """The most relevant phrase of each pixel, from one relevancy map after another."""

    def __init__(self) -> None:
        self._best: Map | None = None
        self._phrases: list[str] = []

    def add(self, phrase: str, relevancy: Map) -> None:
        """Compare the (H, W) relevancy of one more phrase, 0 where nothing is visible; of equal ones, the first stays."""
        if self._best is None:
            self._best = np.zeros_like(relevancy)
            self._winner = np.full(relevancy.shape, -1, np.int32)
        better = relevancy > self._best
        self._best[better], self._winner[better] = relevancy[better], len(self._phrases)
        self._phrases.append(phrase)

    def mask(self, phrase: str) -> Mask:
        """(H, W) bool: where a phrase is the most relevant one."""
        return self._winner == self._phrases.index(phrase)


def count_right(query: Query, mask: Mask, layers: InstanceMap, instances: Sequence[Instance]) -> int:
    """Number of pixels of a query's mask that are labeled with its category and no other."""
    own, others = (
        [index for index, one in enumerate(instances) if (one.category == query.category) == same]
        for same in (True, False)
    )
    return int((mask & mask_of(layers, own) & ~mask_of(layers, others)).sum())


def pixel_accuracy(frames: Sequence[int], right: Sequence[int], pixels: int) -> float | None:
    """Share of a frame's pixels whose class is right, mean over frames, 0..1; None without queries.

    Args:
        frames: frame of each query.
        right: its ``count_right``.
        pixels: number of pixels of a frame that show the scene. Those without a label count as wrong, as in 3D-OVS.
    """
    if not frames:
        return None
    return sum(right) / pixels / len({*frames})

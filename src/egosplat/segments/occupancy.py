"""Measure how many pixels instances cover, and for how many frames each is tracked."""

import numpy as np
from numpy.typing import NDArray


class Occupancy:
    """Coverage statistics of N instances over the segmented frames."""

    def __init__(self, instances: int, valid: NDArray[np.bool_]) -> None:
        """Start with no frame; ``instances``: N, ``valid``: (H, W) bool, pixels that show the scene."""
        self._frames_of = np.zeros(instances, np.int64)
        self._valid = valid
        self._frames = 0
        self._empty_pixels = 0

    def add(self, labels: NDArray[np.int32]) -> None:
        """Count one frame; ``labels``: (L, H, W) instance at each level, -1 for none."""
        found = np.unique(labels)
        self._frames_of[found[found >= 0]] += 1
        self._frames += 1
        self._empty_pixels += int(((labels < 0).all(axis=0) & self._valid).sum())

    def figures(self) -> dict[str, float]:
        """Share of valid pixels without an instance at any level, mean instances per frame, mean frames per instance."""
        views = int(self._frames_of.sum())
        return {
            "pixels_without_instance": self._empty_pixels / max(self._frames * int(self._valid.sum()), 1),
            "instances_per_frame": views / max(self._frames, 1),
            "frames_per_instance": views / max(len(self._frames_of), 1),
        }

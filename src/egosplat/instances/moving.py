"""Tracks of what moves: masks are merged without them, and they are drawn over the things."""

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact

Labels = NDArray[np.int32]


class MovingTracks:
    """The M tracks of segments.zarr that show what moves.

    Attributes:
        level: (M,) int8.
        frames: (M,) int32 number of drawn frames that show each track.
        standing: (S,) int64 instances of segments.zarr that are tracks and stand still. Their masks are merged.
    """

    def __init__(self, segments: Artifact, standing: NDArray[np.int64] | None = None) -> None:
        """Read which instances of segments.zarr move; ``standing``: those that do not, none by default."""
        tracked = segments.read("instances/moving")
        self.standing = np.zeros(0, np.int64) if standing is None else standing
        moving = tracked.copy()
        moving[self.standing] = False
        self.level = segments.read("instances/level")[moving]
        self.frames = np.zeros(len(self.level), np.int32)
        # Label -1 indexes the appended last entry: no instance is no track.
        self._number = np.append(np.where(moving, np.cumsum(moving) - 1, -1), -1).astype(np.int32)
        self._single = np.append(~tracked, False)

    def keep(self, labels: Labels) -> tuple[Labels, NDArray[np.bool_]]:
        """Labels (L, H, W) of segments.zarr of the tracks alone, and (H, W) bool, no pixel."""
        return np.where(self._number[labels] >= 0, labels, np.int32(-1)), np.zeros(labels.shape[1:], bool)

    def remove(self, labels: Labels) -> tuple[Labels, NDArray[np.bool_]]:
        """Labels (L, H, W) of segments.zarr without pixels of any track, and (H, W) bool, which pixels these are."""
        moving = (self._number[labels] >= 0).any(axis=0)
        # A frame without masks of its own would count for the tracks that stand still, and against all others.
        voting = self._single[labels].any()
        return np.where(moving | ~voting, np.int32(-1), labels), moving

    def draw(self, labels: Labels, over: Labels, first: int) -> Labels:
        """Draw the tracks of a frame over its things.

        Args:
            labels: (L, H, W) of segments.zarr.
            over: (L, H, W) things. Where a track of any level is, none stays.
            first: number of the first track in the result.
        """
        track = self._number[labels]
        shown = track >= 0
        self.frames[np.unique(track[shown])] += 1
        return np.where(shown.any(axis=0), np.where(shown, track + np.int32(first), -1), over)

"""Tracks of what moves: masks are merged without them, and they are drawn over the things."""

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.instances.lifted_masks import MaskLifter
from egosplat.instances.things import agreement
from egosplat.progress import log

Labels = NDArray[np.int32]


class MovingTracks:
    """The M tracks of segments.zarr that show what moves.

    Attributes:
        level: (M,) int8.
        frames: (M,) int32 number of drawn frames that show each track.
    """

    def __init__(self, segments: Artifact, moving: NDArray[np.bool_]) -> None:
        """Select instances of segments.zarr by (N,) bool."""
        self.level = segments.read("instances/level")[moving]
        self.frames = np.zeros(len(self.level), np.int32)
        # Label -1 indexes the appended last entry: no instance is no track.
        self._number = np.append(np.where(moving, np.cumsum(moving) - 1, -1), -1).astype(np.int32)

    def pixels(self, labels: Labels) -> NDArray[np.bool_]:
        """(H, W) bool, pixels of any track in labels (L, H, W) of segments.zarr."""
        return (self._number[labels] >= 0).any(axis=0)

    def keep(self, labels: Labels) -> tuple[Labels, NDArray[np.bool_]]:
        """Labels (L, H, W) of segments.zarr of the tracks alone, and (H, W) bool, all False."""
        return np.where(self._number[labels] >= 0, labels, np.int32(-1)), np.zeros(labels.shape[1:], bool)

    def remove(self, labels: Labels) -> tuple[Labels, NDArray[np.bool_]]:
        """Labels (L, H, W) of segments.zarr without pixels of any track, and (H, W) bool, which pixels these are."""
        moving = self.pixels(labels)
        return np.where(moving, np.int32(-1), labels), moving

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


def find_moving(lifter: MaskLifter) -> MovingTracks:
    """Find the tracks that move among those that the transient network began.

    The network also calls some static surfaces moving. The masks of such a track lie on the same Gaussians in all
    frames, so most of them agree with their union as much as masks that are merged. The masks of what moves do not.
    """
    segments, keys = lifter.segments, lifter.keys
    moving = segments.read("instances/moving")
    lifted = lifter.lift(MovingTracks(segments, moving).keep)
    if lifted is None:
        return MovingTracks(segments, moving)
    resting = np.zeros_like(moving)
    for name in np.unique(lifted.instance):
        mine = np.flatnonzero(lifted.instance == name)
        resting[name] = len(mine) > 1 and np.median(agreement(lifted, mine, keys.inside)) >= keys.merge_iou
    log(f"{resting.sum()} of {moving.sum()} tracks of what seems to move lie on static surfaces")
    return MovingTracks(segments, moving & ~resting)

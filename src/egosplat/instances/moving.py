"""Tracks of what moves: masks are merged without them, and they are drawn over the things."""

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.transient import InstanceScores
from egosplat.gaussians.render import render
from egosplat.instances.lifted_masks import MaskLifter
from egosplat.progress import log

Labels = NDArray[np.int32]

# Share of a frame's static pixels that do not stand out from the render.
_ORDINARY = 0.9

# Share of a track's pixels that stand out, above which it moves.
_MOSTLY = 0.5


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

    The network also calls some static surfaces moving. There a frame looks like the render of the temporary Gaussians,
    as far as other frames show the surface. A track moves if most of its pixels stand out from the render, more than 90 %
    of the static pixels of their frame do. Brightness and blur of a frame raise both.
    """
    segments, views = lifter.segments, lifter.views
    began = segments.read("instances/moving")
    tracks, scores = MovingTracks(segments, began), InstanceScores(len(began))
    for place, frame in enumerate(views.frame.tolist()):
        labels = lifter.labels(frame)
        moving = tracks.pixels(labels)
        static = lifter.valid_pixels & ~moving
        if moving.any() and static.any():
            residual = _residual(lifter, place)
            stands_out = residual > np.quantile(residual[static], _ORDINARY)
            scores.add(np.where(moving & lifter.valid_pixels, labels, -1), stands_out)
    # Tracks without a pixel at the working size: nothing speaks against the network.
    unseen = scores.pixels == 0
    moves = began & (unseen | (scores.scores > _MOSTLY))
    log(f"{moves.sum()} of {len(tracks.level)} tracks move")
    return MovingTracks(segments, moves)


def _residual(lifter: MaskLifter, place: int) -> NDArray[np.float32]:
    """(H, W) mean absolute difference of a view's colors to the render of the temporary Gaussians."""
    views = lifter.views
    image, _, _ = render(
        lifter.gaussians,
        views.camera,
        views.camera_to_world[place],
        lifter.settings,
        sh_degree=0,
        background=None,
    )
    return (image - views.picture(place)).abs().mean(-1).numpy()

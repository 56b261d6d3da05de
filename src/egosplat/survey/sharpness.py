"""Find blurred frames whose view sharper frames show as well."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import shown_pixels
from egosplat.geometry import Array, Camera, invert, transform
from egosplat.images import measure_sharpness
from egosplat.progress import track
from egosplat.survey.views import Bools, view_change

# Frames are compared if their views differ by less: further away, an object is seen from another side [deg].
MAX_CHANGE_DEG = 30.0
# A smaller difference of sharpness is no loss: that of a motion of 1.5 px during the exposure.
_MIN_DIFFERENCE = 0.5
# Places of a picture that a sharper frame has to show: the centers of a grid of this side.
_PLACES = 8
# Frames whose median a frame is compared with for the scatter: one blurred frame does not change it.
_NEAREST = 3
# Median absolute difference to the median of three, for normal distributions, to their standard deviation.
_SIGMA_OF_DIFFERENCE = 1.4826 / np.sqrt(1.45)


@dataclass(frozen=True, eq=False)
class Sharpness:
    """Sharpness of F frames, and the frames that are too blurred.

    Attributes:
        values: (F,) float64, see ``measure_sharpness``; NaN without edges.
        scatter: standard deviation of the sharpness of one view; None if no two frames show one view.
        min_difference: a frame is blurred that is less sharp by this than the frames that show its view; None without
            scatter.
        replaced_by: the sharper frames of each dropped frame.
    """

    values: Array
    scatter: float | None
    min_difference: float | None
    replaced_by: dict[int, list[int]]


@dataclass(frozen=True, eq=False)
class Views:
    """The views of F frames.

    Attributes:
        camera: of all frames.
        camera_to_world: (F, 4, 4) float64.
        depths: (F,) float64 median depth [m]; NaN if unknown.
        shown_in: returns the (H, W) bool pixels of a frame that show the scene.
    """

    camera: Camera
    camera_to_world: Array
    depths: Array
    shown_in: Callable[[int], Bools]

    def shown(self, frame: int, others: Sequence[int]) -> bool:
        """Whether every place of a frame, at its median depth, is in the picture of one of the other frames."""
        missing = transform(self.camera_to_world[frame], self._places(frame))
        for other in others:
            pixels = self.camera.project(transform(invert(self.camera_to_world[other]), missing))
            inside = self.camera.contains(pixels)
            column, row = np.where(inside[:, None], pixels, 0.0).astype(np.int64).T
            missing = missing[~(inside & self.shown_in(other)[row, column])]
        return not len(missing)

    def _places(self, frame: int) -> Array:
        """(P, 3) points at a frame's median depth, evenly over the pixels that show the scene."""
        along = (np.arange(_PLACES) + 0.5) / _PLACES
        v, u = np.meshgrid(along * self.camera.height, along * self.camera.width, indexing="ij")
        kept = self.shown_in(frame)[v.astype(np.int64), u.astype(np.int64)]
        x = (u[kept] - self.camera.cx) / self.camera.fx
        y = (v[kept] - self.camera.cy) / self.camera.fy
        return self.depths[frame] * np.stack([x, y, np.ones_like(x)], axis=1)


def measure_all(frames: Artifact) -> Array:
    """(F,) float64 sharpness of every frame of a recording; NaN without edges."""
    valid, count = frames.read("valid"), frames.shape("rgb")[0]
    rows = track(range(count), "measuring sharpness", unit="frame")
    return np.array(
        [measure_sharpness(frames.row("rgb", frame), shown_pixels(frames, frame, valid)) for frame in rows]
    )


def find_blurred(
    values: Array, views: Views, trained: Bools, optional: Bools, min_scatters: float
) -> Sharpness:
    """Find the optional frames of which sharper training frames that stay show every place.

    Args:
        values: (F,) float64 from ``measure_all``.
        trained: (F,) bool: frames to train on.
        optional: (F,) bool: those of them that may be dropped.
        min_scatters: smallest difference of sharpness, in units of the recording's own scatter; 0 drops nothing.
    """
    known = (
        np.isfinite(values) & np.isfinite(views.depths) & np.isfinite(views.camera_to_world).all(axis=(1, 2))
    )
    changes = _changes(views, known)
    scatter = _scatter(values, changes)
    if scatter is None or min_scatters <= 0:
        return Sharpness(values, scatter, None, {})
    least = max(min_scatters * scatter, _MIN_DIFFERENCE)
    kept = trained & known
    replaced_by: dict[int, list[int]] = {}
    # The sharpest first: only frames that stay take the place of another.
    candidates = np.flatnonzero(optional & known)
    for frame in candidates[np.argsort(-values[candidates], kind="stable")].tolist():
        close = kept & (changes[frame] < MAX_CHANGE_DEG)
        sharper = np.flatnonzero(close & (values - values[frame] > least)).tolist()
        if sharper and views.shown(frame, sharper):
            replaced_by[frame], kept[frame] = sharper, False
    return Sharpness(values, scatter, least, dict(sorted(replaced_by.items())))


def _changes(views: Views, known: Bools) -> Array:
    """(F, F) float64 change of view from the row's frame to the column's [deg]; inf if unknown and on the diagonal."""
    changes = np.full((len(known), len(known)), np.inf)
    poses = views.camera_to_world
    for frame in np.flatnonzero(known):
        changes[frame, known] = view_change(poses[frame], poses[known], views.depths[frame])
    np.fill_diagonal(changes, np.inf)
    return changes


def _scatter(values: Array, changes: Array) -> float | None:
    """Robust standard deviation of sharpness between each frame and the median of the frames with the nearest views."""
    differences = []
    for frame, row in enumerate(changes):
        nearest = np.argsort(row, kind="stable")[:_NEAREST]
        nearest = nearest[row[nearest] < MAX_CHANGE_DEG]
        if len(nearest):
            differences.append(abs(values[frame] - np.median(values[nearest])))
    return float(_SIGMA_OF_DIFFERENCE * np.median(differences)) if differences else None

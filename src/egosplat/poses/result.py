"""The result of pose estimation, by whichever method."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from egosplat.arrays import Array, Bools, Bytes
from egosplat.errors import UserError
from egosplat.geometry import Camera, is_rigid

# A shorter mean of the cameras' up axes has no reliable direction.
_MIN_MEAN_UP = 1e-3

# Points of a structure from motion that are kept. Two views alone leave a point's depth unchecked.
MIN_TRACK_LENGTH = 3
MAX_ERROR_PX = 2.0


@dataclass(frozen=True)
class Poses:
    """Poses of the frames, and points of the scene; ValueError unless each pose is a rigid motion or NaN.

    Attributes:
        camera_to_world: (F, 4, 4) float64, OpenCV camera axes; NaN where not registered.
        camera: of the frames; COLMAP may have refined it.
        points, point_rgb: (P, 3) float64 in the world [m; COLMAP: arbitrary unit], and (P, 3) uint8.
        up: (3,) float64 unit vector against gravity in the world.
        notes: statistics, as plain JSON.
    """

    camera_to_world: Array
    camera: Camera
    points: Array
    point_rgb: Bytes
    up: Array
    notes: dict[str, Any]

    def __post_init__(self) -> None:
        if not (self.registered | np.isnan(self.camera_to_world).all(axis=(1, 2))).all():
            raise ValueError("a pose is neither a rigid motion nor NaN")
        if not self.registered.any():
            raise ValueError("no frame is registered")

    @property
    def registered(self) -> Bools:
        """(F,) bool: frames with a pose."""
        return is_rigid(self.camera_to_world)


def mean_camera_up(camera_to_world: Array) -> Array:
    """(3,) mean of up (-y) of (N, 4, 4) registered poses, a unit vector; UserError without a common direction."""
    mean = -camera_to_world[:, :3, 1].mean(axis=0)
    length = float(np.linalg.norm(mean))
    if not length > _MIN_MEAN_UP:
        raise UserError("the frames have no common upward direction: turn them upright first")
    return mean / length


def find_parallax(centers: Array, points: Array) -> float | None:
    """Angle under which the median of (P, 3) points sees all (N, 3) cameras [deg]; None without points."""
    if not len(points):
        return None
    extent = float(np.linalg.norm(np.ptp(centers, axis=0)))
    away = float(np.median(np.linalg.norm(points - centers.mean(axis=0), axis=1)))
    return float(np.degrees(np.arctan2(extent, away)))

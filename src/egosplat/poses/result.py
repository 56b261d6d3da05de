"""The result of pose estimation, by whichever method."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.geometry import Camera, is_rigid

# A shorter mean of the cameras' up axes has no reliable direction.
_MIN_MEAN_UP = 1e-3

# Points of a structure from motion that are kept. Two views alone leave a point's depth unchecked.
MIN_TRACK_LENGTH = 3
MAX_REPROJECTION_ERROR_PX = 2.0


@dataclass(frozen=True)
class Poses:
    """Poses of the frames, and points of the scene.

    Attributes:
        camera_to_world: (F, 4, 4) float64, OpenCV camera axes; NaN where not registered.
        registered: (F,) bool: frames with a pose.
        camera: of the frames; COLMAP may have refined it.
        points: (P, 3) float64 in the world [m; COLMAP: arbitrary unit].
        point_rgb: (P, 3) uint8.
        up: (3,) float64 unit vector against gravity in the world.
        notes: statistics, as plain JSON.
    """

    camera_to_world: NDArray[np.float64]
    registered: NDArray[np.bool_]
    camera: Camera
    points: NDArray[np.float64]
    point_rgb: NDArray[np.uint8]
    up: NDArray[np.float64]
    notes: dict[str, Any] = field(default_factory=dict)

    def check(self) -> "Poses":
        """Check what the artifact's schema does not say, and return self.

        Raises:
            ValueError: no frame is registered, a registered pose is not a rigid motion, or an unregistered one is not NaN.
        """
        if not self.registered.any():
            raise ValueError("no frame is registered")
        broken = np.flatnonzero(self.registered & ~is_rigid(self.camera_to_world))
        if len(broken):
            raise ValueError(f"the pose of registered frame {broken[0]} is not a rigid motion")
        if not np.isnan(self.camera_to_world[~self.registered]).all():
            raise ValueError("a frame that is not registered has a pose")
        return self


def unregistered(frames: int) -> NDArray[np.float64]:
    """(frames, 4, 4) float64 NaN: poses of unregistered frames."""
    return np.full((frames, 4, 4), np.nan)


def mean_camera_up(camera_to_world: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) mean of up (-y) of (N, 4, 4) registered poses, a unit vector; UserError without a common direction."""
    mean = -camera_to_world[:, :3, 1].mean(axis=0)
    length = float(np.linalg.norm(mean))
    if not length > _MIN_MEAN_UP:
        raise UserError("the frames have no common upward direction: turn them upright first")
    return mean / length


def find_parallax(centers: NDArray[np.float64], points: NDArray[np.float64]) -> float | None:
    """Angle under which the median point sees all cameras [deg]; alarm ``poses.parallax`` if it is small.

    Args:
        centers: (N, 3) camera centers in the world, N >= 1.
        points: (P, 3) points of the scene; none: 0 for cameras at one place, else None.
    """
    extent = float(np.linalg.norm(np.ptp(centers, axis=0)))
    if not len(points):
        return None if extent > 0 else 0.0
    away = float(np.median(np.linalg.norm(points - centers.mean(axis=0), axis=1)))
    return float(np.degrees(np.arctan2(extent, away)))

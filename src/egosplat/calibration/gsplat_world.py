"""The world in which gsplat's example trainer trains: that of a COLMAP model, turned, centered and scaled."""

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import compose, make_pose, rotate, transform

Array = NDArray[np.float64]

# The up axis of a camera with OpenCV axes.
_UP = np.array([0.0, -1.0, 0.0])


def gsplat_world(camera_to_world: Array, points: Array) -> Array | None:
    """The (4, 4) similarity from the world of a COLMAP model to gsplat's, up to the signs of two axes; None without any.

    The .ply file of gsplat does not tell of it. The signs depend on its version and its linear algebra.

    Args:
        camera_to_world: (F, 4, 4), all images of the model.
        points: (P, 3), all points of the model.
    """
    points = points[np.isfinite(points).all(axis=1)]
    by_cameras = _of_cameras(camera_to_world)
    if len(points) < 3 or not np.isfinite(by_cameras).all():
        return None
    return compose(_principal_axes(transform(by_cameras, points)), by_cameras)


def _of_cameras(camera_to_world: Array) -> Array:
    """Bring the mean up axis to -y, the median of the points looked at to the origin, the median distance to 1."""
    up = -camera_to_world[:, :3, 1].mean(axis=0)
    # Cameras without a common up axis, upside down or at one place give no number.
    with np.errstate(divide="ignore", invalid="ignore"):
        up /= np.linalg.norm(up)
        x, y, z = np.cross(up, _UP)
        skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turn = np.eye(3) + skew + skew @ skew / (1 + up @ _UP)
        centers = rotate(turn, camera_to_world[:, :3, 3])
        ahead = rotate(turn, camera_to_world[:, :3, 2])
        # The point of each camera's axis that is nearest to the origin.
        nearest = centers - (ahead * centers).sum(axis=1, keepdims=True) * ahead
        shift = -np.median(nearest, axis=0)
        scale = 1.0 / np.median(np.linalg.norm(centers + shift, axis=1))
        return make_pose(scale * turn, scale * shift)


def _principal_axes(points: Array) -> Array:
    """Bring the median of the points to the origin and their principal axes to x, y, z."""
    center = np.median(points, axis=0)
    values, axes = np.linalg.eigh(np.cov(points - center, rowvar=False))
    axes = axes[:, values.argsort()[::-1]]
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    return make_pose(axes.T, -rotate(axes.T, center))

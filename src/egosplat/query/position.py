"""From a pixel to a place in the scene."""

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import Array, Camera, transform


def unproject(camera: Camera, camera_to_world: Array, points: Array, depth: Array) -> Array:
    """The places that image points show.

    Args:
        camera: pinhole camera.
        camera_to_world: (4, 4) float64.
        points: (..., 2) float64 image points [px].
        depth: (...,) float64 camera z [m].

    Returns:
        (..., 3) float64 in the world [m].
    """
    points, depth = np.asarray(points, np.float64), np.asarray(depth, np.float64)
    x = (points[..., 0] - camera.cx) / camera.fx
    y = (points[..., 1] - camera.cy) / camera.fy
    return transform(camera_to_world, np.stack([x, y, np.ones_like(x)], axis=-1) * depth[..., None])


def pixel_position(
    camera: Camera, camera_to_world: Array, pixel: tuple[int, int], depth: NDArray[np.float32]
) -> Array | None:
    """The place that a pixel's centre shows.

    Args:
        camera, camera_to_world: of the picture.
        pixel: column and row in it.
        depth: (h, w) float32 expected camera z [m], of the same view in any resolution.

    Returns:
        (3,) float64 in the world [m]; None where there is no depth (0, or not finite).
    """
    point = np.array(pixel) + 0.5
    height, width = depth.shape
    column, row = (point * [width / camera.width, height / camera.height]).astype(int)
    found = float(depth[row, column])
    if not (np.isfinite(found) and found > 0):
        return None
    return unproject(camera, camera_to_world, point, np.array(found))

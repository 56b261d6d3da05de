"""Where a static point can be seen after the camera has moved, and how far from there it is seen.

The second picture is turned first as the camera of the first was, by the homography of the rotation between them. What
is left is a translation: a static point at depth z moves along the line to the epipole, the further the nearer it is.
Between a point infinitely far away, which stays where it is, and one at the least depth this is a segment; without
translation it is a point. So a turn on the spot needs no case of its own, and its epipole no definition.
"""

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import invert

Array = NDArray[np.float64]

_LEAST_RATIO = 0.1
"""Of a point's depth in the second camera to its depth in the first; nearer to the second camera nothing is seen."""


def rotation_homography(matrix: Array, first: Array, second: Array) -> Array:
    """(3, 3) homography that turns a picture: from pixels as ``first`` is turned to pixels as ``second`` is.

    Args:
        matrix: (3, 3) intrinsic matrix of both.
        first, second: (4, 4) camera_to_world.
    """
    relative = second[:3, :3].T @ first[:3, :3]
    return matrix @ relative @ np.linalg.inv(matrix)


def epipole(matrix: Array, first: Array, second: Array) -> Array:
    """(3,) homogeneous image of the first camera's centre in the second picture, turned as the first is [px m]."""
    return matrix @ (invert(first) @ second)[:3, 3] * -1.0


def longest_flow(pixels: Array, towards: Array, least_depth: float) -> Array:
    """What the nearest static point moves by in the second picture, turned as the first is.

    Args:
        pixels: (..., 2) in the first picture [px].
        towards: (3,) homogeneous, from ``epipole``.
        least_depth: of anything static along the first camera's axis, more than 0 [m].

    Returns:
        (..., 2) float64 [px]; static points further away move by a share of it.
    """
    # x z + e is where a point at depth z is seen; nothing is seen behind, or right before, the second camera.
    depth = max(least_depth, -towards[2] / (1.0 - _LEAST_RATIO))
    return (towards[:2] - towards[2] * np.asarray(pixels, np.float64)) / (depth + towards[2])


def miss_distance(pixels: Array, flow: Array, towards: Array, least_depth: float) -> Array:
    """How far pixels end from where a static point can: from its segment of the epipolar line.

    Args:
        pixels: (..., 2) in the first picture [px].
        flow: (..., 2) what each moves by in the second picture, which is turned as the first is [px].
        towards: (3,) homogeneous, from ``epipole``.
        least_depth: of anything static along the first camera's axis, more than 0 [m].

    Returns:
        (...) float64 [px].
    """
    flow = np.asarray(flow, np.float64)
    span = longest_flow(pixels, towards, least_depth)
    length = (span**2).sum(axis=-1)
    along = (flow * span).sum(axis=-1) / np.where(length > 0, length, 1.0)
    return np.linalg.norm(flow - along.clip(0.0, 1.0)[..., None] * span, axis=-1)

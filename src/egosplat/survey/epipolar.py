"""Compute where static points can appear after the camera has moved.

The second image is first rotated to the orientation of the first camera, by the homography of their relative rotation.
Only the translation remains: a static point moves along the line through the epipole, by more if it is nearer.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Minimum depth in the second camera relative to the depth in the first: nothing nearer to the camera is visible.
_MIN_DEPTH_RATIO = 0.1


def rotation_homography(intrinsics: Array, first: Array, second: Array) -> Array:
    """(3, 3) homography from pixels in the orientation of ``first`` to pixels in the orientation of ``second``.

    Args:
        intrinsics: (3, 3) matrix of both images.
        first, second: (4, 4) camera_to_world.
    """
    relative = second[:3, :3].T @ first[:3, :3]
    return intrinsics @ relative @ np.linalg.inv(intrinsics)


def max_static_flow(pixels: Array, epipole: Array, min_depth: float) -> Array:
    """Flow to the second, rotated image of a static point at the minimum depth.

    Args:
        pixels: (..., 2) in the first image [px].
        epipole: (3,) homogeneous image of the first camera's center in the second image after rotation [px m].
        min_depth: smallest depth of static points in the first camera, positive [m].

    Returns:
        (..., 2) float64 [px]; points further away move by a fraction of it.
    """
    # A point at depth z appears at x z + e. Points behind or right before the second camera are not visible.
    depth = max(min_depth, -epipole[2] / (1.0 - _MIN_DEPTH_RATIO))
    return (epipole[:2] - epipole[2] * np.asarray(pixels, np.float64)) / (depth + epipole[2])

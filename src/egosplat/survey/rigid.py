"""Fit the error of the pose between two images: a small rigid correction that explains their whole optical flow at once.

The second image is first rotated to the orientation of the first camera. Only the translation remains: a static point moves
along the line through the epipole, by more if it is nearer. Every point keeps a depth of its own, so only flow across its
epipolar line is left over. A moving thing does not fit the correction, and hardly changes it: the fit is robust.
"""

from dataclasses import dataclass

import numpy as np

from egosplat.arrays import Array, Reals

# Standard deviation of a correction before anything is measured [rad; meters per meter of depth].
_PRIOR = 0.03
# Largest correction, per axis.
_LARGEST = 0.2
# Neighboring flow vectors share their error: so many of them count as one.
_SHARED = 50.0
_MAX_PIXELS = 1200
_ITERATIONS = 6
# Smallest scale of the residual: flow is not more accurate [px].
_MIN_SCALE = 0.03
_STEP = 1e-4
# Robust scale of a Gaussian from its median absolute value in one dimension.
_GAUSSIAN = 1.4826
# Minimum depth in the second camera relative to the depth in the first: nothing nearer to the camera is visible.
_MIN_DEPTH_RATIO = 0.1


@dataclass(frozen=True, eq=False)
class View:
    """Two images in one orientation: their camera, and what is known of the scene.

    Attributes:
        intrinsics: (3, 3) matrix [px].
        position: (3,) of the second camera in the axes of the first [m].
        depth: typical depth of static points, positive [m].
        min_depth: smallest depth of static points, positive [m].
    """

    intrinsics: Array
    position: Array
    depth: float
    min_depth: float


def rotation_homography(intrinsics: Array, first: Array, second: Array) -> Array:
    """(3, 3) homography from pixels in the orientation of ``first`` to that of ``second``, (4, 4) camera_to_world."""
    return intrinsics @ (second[:3, :3].T @ first[:3, :3]) @ np.linalg.inv(intrinsics)


def static_residual(view: View, pixels: Array, flow: Reals, correction: Array) -> Array:
    """(..., 2) float64 vector from the nearest place where a static point can appear to the target of its flow [px].

    Args:
        pixels: (..., 2) in the first image [px].
        flow: (..., 2) from there to the second image, rotated to the orientation of the first [px].
        correction: (6,) rotation of the second camera [rad], and its shift in units of the typical depth.
    """
    flow = corrected_flow(view, pixels, flow, correction)
    segment = static_segment(view, pixels, correction)
    length = (segment**2).sum(axis=-1)
    along = (flow * segment).sum(axis=-1) / np.where(length > 0, length, 1.0)
    return flow - along.clip(0.0, 1.0)[..., None] * segment


def corrected_flow(view: View, pixels: Array, flow: Reals, correction: Array) -> Array:
    """(..., 2) flow to the second image with its corrected orientation [px]."""
    ends = np.asarray(pixels, np.float64) + flow
    return turn(view.intrinsics, ends, correction[:3]) - pixels


def static_segment(view: View, pixels: Array, correction: Array) -> Array:
    """(..., 2) flow of static points at the smallest depth [px]; others move by a fraction of it."""
    shift = view.depth * correction[3:]
    position = view.position + shift
    # Flow does not tell how far the camera moved: the length may be as wrong as what is corrected.
    length = np.linalg.norm(position)
    position = position * (1.0 + np.linalg.norm(shift) / max(length, 1e-300))
    # Homogeneous image of the first camera's center in the second image after rotation: a point at depth z appears at x z + e.
    epipole = -(view.intrinsics * position).sum(axis=1)
    # Points behind or right before the second camera are not visible.
    depth = max(view.min_depth, -epipole[2] / (1.0 - _MIN_DEPTH_RATIO))
    return (epipole[:2] - epipole[2] * np.asarray(pixels, np.float64)) / (depth + epipole[2])


def turn(intrinsics: Array, pixels: Array, rotation: Array) -> Array:
    """(..., 2) pixels after their rays turn by a small rotation vector, exact to its third power [px]."""
    focal, center = intrinsics[[0, 1], [0, 1]], intrinsics[:2, 2]
    (x, y), (a, b, c) = np.moveaxis((np.asarray(pixels, np.float64) - center) / focal, -1, 0), rotation
    once_x, once_y, once_z = b - c * y, c * x - a, a * y - b * x
    x = x + once_x + (b * once_z - c * once_y) / 2
    y = y + once_y + (c * once_x - a * once_z) / 2
    z = 1.0 + once_z + (a * once_y - b * once_x) / 2
    return np.stack([x, y], axis=-1) / np.maximum(z, 0.1)[..., None] * focal + center


def fit_correction(view: View, pixels: Array, flow: Reals) -> Array:
    """(6,) correction that explains most of the (N, 2) flow from (N, 2) pixels of the first image; zeros without any."""
    stride = max(1, -(-len(pixels) // _MAX_PIXELS))
    pixels, flow = np.asarray(pixels, np.float64)[::stride], np.asarray(flow, np.float64)[::stride]
    found = np.zeros(6)
    for _ in range(_ITERATIONS if len(pixels) else 0):
        residual = static_residual(view, pixels, flow, found)
        moved = [static_residual(view, pixels, flow, found + step) for step in np.eye(6) * _STEP]
        derivative = np.stack([(shifted - residual) / _STEP for shifted in moved])
        squared = (residual**2).sum(axis=-1)
        scale = robust_scale(np.sqrt(squared))
        # Geman and McClure's weights: a residual of several scales has none.
        weight = (1.0 + squared / (4 * scale**2)) ** -2 / (_SHARED / stride * scale**2)
        normal = np.einsum("inc,jnc,n->ij", derivative, derivative, weight) + np.eye(6) / _PRIOR**2
        slope = np.einsum("inc,nc,n->i", derivative, residual, weight) + found / _PRIOR**2
        found = (found - np.linalg.solve(normal, slope)).clip(-_LARGEST, _LARGEST)
    return found


def robust_scale(distance: Array) -> float:
    """Standard deviation of distances by their median, not less than what flow can measure [px]."""
    return max(_MIN_SCALE, _GAUSSIAN * float(np.median(distance))) if distance.size else _MIN_SCALE

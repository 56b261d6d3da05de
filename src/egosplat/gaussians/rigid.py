"""Small rigid corrections of camera poses, differentiably, in float64.

A correction is 6 numbers: a translation of the camera's center and a rotation vector about that center, both along the
axes of the world. Neither depends on where the world's origin lies.
"""

import torch
from torch import Tensor

# Below this squared angle [rad²], Taylor series replace quotients of 0 by 0. Their error is below 1e-17.
_SMALL = 1e-8


def rotation_of(vector: Tensor) -> Tensor:
    """Rotation matrix of a rotation vector, by the formula of Rodrigues. Differentiable at every angle, 0 included.

    Args:
        vector: (..., 3) axis times angle [rad].

    Returns:
        (..., 3, 3).
    """
    squared = (vector * vector).sum(-1)[..., None, None]
    small = squared < _SMALL
    # The root has no gradient at 0, and ``where`` alone would pass on its NaN.
    angle = torch.where(small, 1.0, squared).sqrt()
    first = torch.where(small, 1.0 - squared / 6.0, angle.sin() / angle)
    # 1 - cos(a) = 2 sin(a / 2)^2, which keeps its digits for small angles.
    second = torch.where(small, 0.5 - squared / 24.0, 2.0 * ((angle / 2.0).sin() / angle).square())
    cross = _cross_matrix(vector)
    return torch.eye(3, dtype=vector.dtype) + first * cross + second * (cross @ cross)


def corrected(camera_to_world: Tensor, correction: Tensor) -> Tensor:
    """Apply corrections to poses.

    Args:
        camera_to_world: (..., 4, 4) float64.
        correction: (..., 6) float64: translation [m], rotation vector [rad].

    Returns:
        (..., 4, 4) float64. A correction of zeros returns the pose itself, bit for bit.
    """
    rotation = rotation_of(correction[..., 3:]) @ camera_to_world[..., :3, :3]
    center = camera_to_world[..., :3, 3] + correction[..., :3]
    above = torch.cat([rotation, center[..., None]], dim=-1)
    return torch.cat([above, camera_to_world[..., 3:, :]], dim=-2)


def inverted(pose: Tensor) -> Tensor:
    """Inverse of a (4, 4) rigid motion, as ``egosplat.geometry.invert``; differentiable."""
    rotation = pose[:3, :3].T
    above = torch.cat([rotation, -(rotation @ pose[:3, 3:])], dim=1)
    return torch.cat([above, pose[3:]])


def angle_of(vector: Tensor) -> Tensor:
    """The angle [rad], 0 to pi, of (..., 3) rotation vectors of any length."""
    length = torch.linalg.vector_norm(vector, dim=-1)
    return (length.remainder(2.0 * torch.pi) - torch.pi).abs().neg() + torch.pi


def _cross_matrix(vector: Tensor) -> Tensor:
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    rows = [torch.stack(row, -1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return torch.stack(rows, -2)

"""Move Gaussians to another world: turned, shifted and scaled, with their view-dependent colors."""

import math
from dataclasses import replace

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from egosplat.gaussians.model import Gaussians
from egosplat.geometry import Array, is_rigid, transform
from egosplat.rasterize.reference.spherical_harmonics import sh_basis

# Scales and shifts up to this leave Gaussians finite in float32.
LARGEST = 1e15

# Directions in which the colors before and after must agree, several for each of the 16 functions of degree 3.
_DIRECTIONS = 200


def split_similarity(matrix: Array) -> tuple[float, Array]:
    """The scale of a (4, 4) similarity, and its (3, 3) rotation; ValueError if it is no rotation with a scale and a shift."""
    # The length of a row: a determinant may overflow.
    scale = math.hypot(*matrix[0, :3]) or math.nan
    rigid = np.array(matrix, np.float64)
    rigid[:3, :3] /= scale
    if not (is_rigid(rigid, 1e-3) and 1 / LARGEST <= scale <= LARGEST and (abs(matrix) <= LARGEST).all()):
        raise ValueError(f"no rotation with a scale and a shift, of numbers up to {LARGEST:g}")
    return scale, rigid[:3, :3]


def moved(gaussians: Gaussians, matrix: Array) -> Gaussians:
    """Apply a (4, 4) similarity to Gaussians on the CPU; the identity leaves every bit. Raises as ``split_similarity``."""
    scale, rotation = split_similarity(matrix)
    if np.array_equal(matrix, np.eye(4)):
        return gaussians
    shifted = replace(
        gaussians,
        means=torch.from_numpy(transform(matrix, gaussians.means.numpy())).float(),
        log_scales=gaussians.log_scales + float(np.log(scale)),
    )
    if np.array_equal(rotation, np.eye(3)):
        return shifted
    turn = Rotation.from_matrix(rotation)
    quats = turn * Rotation.from_quat(gaussians.quats.double().numpy(), scalar_first=True)
    mixing = _sh_turn(turn.as_matrix(), gaussians.sh_degree)
    return replace(
        shifted,
        quats=torch.from_numpy(quats.as_quat(scalar_first=True)).float(),
        sh=torch.einsum("jk,nkc->njc", mixing, gaussians.sh),
    )


def _sh_turn(rotation: Array, degree: int) -> Tensor:
    """(K, K) matrix that gives turned Gaussians their colors from the turned directions."""
    random = np.random.default_rng(0).normal(size=(_DIRECTIONS, 3))
    directions = torch.from_numpy(random / np.linalg.norm(random, axis=1, keepdims=True))
    turned = directions @ torch.from_numpy(rotation).T
    return torch.linalg.lstsq(sh_basis(degree, turned), sh_basis(degree, directions)).solution.float()

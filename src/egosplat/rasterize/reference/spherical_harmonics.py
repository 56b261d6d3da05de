"""Real spherical harmonics up to degree 3, in the order and with the signs of 3DGS."""

import math

import torch
import torch.nn.functional as F
from torch import Tensor


def spherical_harmonics(degree: int, dirs: Tensor, coeffs: Tensor) -> Tensor:
    """(N, 3) sums of spherical harmonics up to ``degree``, 0 to 3, without the constant 0.5 of 3DGS colors.

    ``dirs`` are (N, 3) of any length, ``coeffs`` (N, K, 3) with K >= (degree + 1)²; further ones are ignored.
    """
    basis = sh_basis(degree, F.normalize(dirs, dim=-1))
    return torch.einsum("nk,nkc->nc", basis, coeffs[:, : basis.shape[-1]])


def sh_basis(degree: int, dirs: Tensor) -> Tensor:
    """(N, (degree + 1)²) values of the functions in (N, 3) unit directions; ``degree`` is 0 to 3."""
    x, y, z = dirs.unbind(dim=-1)
    xx, yy, zz = x * x, y * y, z * z
    # The factors normalize each function: its square integrates to 1 over the sphere.
    # Coefficient l² + l + m belongs to the real harmonic Y_lm with the Condon-Shortley phase: degree 1 is (-y, z, -x),
    # as in 3DGS (Kerbl et al. 2023) and gsplat.
    functions = [torch.full_like(x, _norm(1 / 4))]
    if degree >= 1:
        functions += [-_norm(3 / 4) * y, _norm(3 / 4) * z, -_norm(3 / 4) * x]
    if degree >= 2:
        functions += [
            _norm(15 / 4) * x * y,
            -_norm(15 / 4) * y * z,
            _norm(5 / 16) * (2 * zz - xx - yy),
            -_norm(15 / 4) * x * z,
            _norm(15 / 16) * (xx - yy),
        ]
    if degree >= 3:
        functions += [
            -_norm(35 / 32) * y * (3 * xx - yy),
            _norm(105 / 4) * x * y * z,
            -_norm(21 / 32) * y * (4 * zz - xx - yy),
            _norm(7 / 16) * z * (2 * zz - 3 * xx - 3 * yy),
            -_norm(21 / 32) * x * (4 * zz - xx - yy),
            _norm(105 / 16) * z * (xx - yy),
            -_norm(35 / 32) * x * (xx - 3 * yy),
        ]
    return torch.stack(functions, dim=-1)


def _norm(fraction: float) -> float:
    return math.sqrt(fraction / math.pi)

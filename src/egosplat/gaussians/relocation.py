"""Relocation of Gaussians onto live ones (3DGS-MCMC, Kheradmand et al. 2024).

Deviation from the paper: a live Gaussian takes on at most as many others as keep the shared opacity above
``min_opacity``. Otherwise a few live ones that receive many dead ones would all die.
"""

import math

import torch
from torch import Tensor

from egosplat.errors import UserError

# The relocation formulas have no finite result for opacity 1.
_LARGEST_OPACITY = 1.0 - 1e-6

# Length of the series in ``relocated``: the k-th term is at most 13.9^k / k!, so the rest is below 1e-40.
_TERMS = 100

# Shared opacities exceed ``min_opacity`` by this factor, so that rounding kills no Gaussian.
_MARGIN = 1.1


def draw_hosts(
    opacities: Tensor, live: Tensor, count: int, min_opacity: float, generator: torch.Generator
) -> Tensor:
    """Draw live Gaussians with probability proportional to their opacity.

    Args:
        opacities: (N,) float32.
        live: (N,) bool.
        count: number of draws.
        min_opacity: lower bound of the opacity that a host shares with its copies.

    Returns:
        (M,) int64, M <= count, ascending, with repetitions.

    Raises:
        UserError: no Gaussian is live.
    """
    rows = live.nonzero().squeeze(1)
    if not len(rows):
        raise UserError(
            f"splats: none of {len(live)} Gaussians has an opacity above {min_opacity}; "
            "check the poses and masks, or lower the opacity regulariser"
        )
    weights = opacities[rows].double()
    # Inverse transform sampling, because torch.multinomial takes at most 2^24 categories.
    edges = weights.cumsum(dim=0)
    drawn = torch.rand(count, generator=generator, device=generator.device, dtype=torch.float64)
    which = torch.searchsorted(edges, drawn.to(edges.device) * edges[-1], right=True)
    which = which.clamp(max=len(rows) - 1).sort().values
    # Draws are sorted: the position among equal draws counts the copies of a host so far.
    occurrence = torch.arange(count, device=which.device) - torch.searchsorted(which, which)
    return rows[which[occurrence + 2 <= most_copies(weights, min_opacity)[which]]]


def most_copies(opacities: Tensor, min_opacity: float) -> Tensor:
    """Return the (N,) largest n for which ``1 - (1 - opacity)^(1/n)`` exceeds ``min_opacity`` by a margin."""
    transmittance = torch.log1p(-opacities.clamp(max=_LARGEST_OPACITY))
    return (transmittance / math.log1p(-_MARGIN * min_opacity)).floor()


def relocated(opacities: Tensor, copies: Tensor) -> tuple[Tensor, Tensor]:
    """Return opacity and scale at which n equal copies look like the Gaussian that they replace.

    With n copies: ``o' = 1 - (1 - o)^(1/n)`` and ``scale' = scale * o / s`` with
    ``s = sum_{i=1..n} sum_{k=0..i-1} C(i-1, k) (-1)^k o'^(k+1) / sqrt(k+1)``.

    Args:
        opacities: (M,) in (0, 1].
        copies: (M,) integer n >= 1, including the original.

    Returns:
        (M,) float64 new opacities, and (M,) float64 scale factors.
    """
    opacity, n = opacities.double().clamp(max=_LARGEST_OPACITY), copies.double()
    new_opacity = -torch.expm1(torch.log1p(-opacity) / n)
    # The outer sum of the binomials is C(n, k + 1), which leaves one series. Its terms shrink quickly for any n.
    term, total = n * new_opacity, n * new_opacity
    for k in range(1, min(_TERMS, int(copies.max()) if len(copies) else 1)):
        term = term * -(n - k).clamp(min=0.0) / (k + 1) * new_opacity
        total = total + term / math.sqrt(k + 1)
    return new_opacity, opacity / total

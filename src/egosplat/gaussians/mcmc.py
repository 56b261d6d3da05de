"""3D Gaussian splatting as Markov chain Monte Carlo (Kheradmand et al. 2024).

Replaces clone, split and prune thresholds. Dead Gaussians (opacity at most ``min_opacity``) move onto live ones,
drawn by opacity. The number grows by 5 % per step up to a cap. Noise in every iteration lets Gaussians explore
(stochastic gradient Langevin dynamics).
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from egosplat.errors import UserError
from egosplat.gaussians.model import Gaussians, rotation_matrices
from egosplat.gaussians.optimizer import Adam
from egosplat.gaussians.schedule import Schedule
from egosplat.gaussians.strategy import Strategy, random_normal, replace_rows

# k of the paper: steepness of the noise gate at ``min_opacity``.
_GATE_STEEPNESS = 100.0


@dataclass(frozen=True)
class McmcOptions:
    """Parameters of 3DGS-MCMC; the defaults are the paper's.

    Attributes:
        min_opacity: a Gaussian with at most this opacity is dead.
        growth: fraction of Gaussians added per step, up to the cap.
        noise_lr: noise factor, on top of the learning rate of the means.
        opacity_reg, scale_reg: loss weights of the mean opacity and the mean scale.
    """

    max_gaussians: int
    min_opacity: float = 0.005
    growth: float = 0.05
    noise_lr: float = 5e5
    opacity_reg: float = 0.01
    scale_reg: float = 0.01


class Mcmc(Strategy):
    """Relocation by opacity: 3DGS-MCMC. It collects no statistics. Use it with a schedule scaled from ``STOCK_MCMC``."""

    def __init__(self, options: McmcOptions, schedule: Schedule) -> None:
        self.options = options
        self.schedule = schedule
        # The trainer adds these to the loss. Without them no Gaussian would die, and none would be relocated.
        self.opacity_reg = options.opacity_reg
        self.scale_reg = options.scale_reg

    @torch.no_grad()
    def step(
        self, iteration: int, gaussians: Gaussians, optimizer: Adam, generator: torch.Generator
    ) -> Gaussians:
        """Relocate and grow when scheduled, and always add noise. See ``Strategy.step``."""
        options = self.options
        if self.schedule.densifies(iteration):
            relocate(gaussians, optimizer, options.min_opacity, generator)
            wanted = min(math.ceil((1.0 + options.growth) * gaussians.count), options.max_gaussians)
            gaussians = grow(gaussians, optimizer, wanted, options.min_opacity, generator)
        add_noise(gaussians, options.noise_lr * optimizer.means_lr, options.min_opacity, generator)
        return gaussians


def relocate(gaussians: Gaussians, optimizer: Adam, min_opacity: float, generator: torch.Generator) -> None:
    """Move dead Gaussians, and those that are not finite, onto live ones, in place.

    Dead ones for which no live one has room stay in place.

    Raises:
        UserError: there are Gaussians but none is live.
    """
    live = alive(gaussians, min_opacity)
    if bool(live.all()):
        return
    broken = ~gaussians.finite()
    # Gaussians that are not finite come first, in case there is no room for all.
    dead = torch.cat([index.nonzero().squeeze(1) for index in (broken, ~live & ~broken)])
    hosts = draw_hosts(gaussians.opacities, live, len(dead), min_opacity, generator)
    _share(gaussians, optimizer, hosts)
    # As in the paper, hosts get zero moments, so that they stay; moved ones keep theirs, so that they explore.
    for tensor in gaussians.detach().parameters().values():
        tensor[dead[: len(hosts)]] = tensor[hosts]
    for name in gaussians.parameters():
        # The moments of a parameter that has just become infinite may be large.
        optimizer.reset_moments(name, broken)


def grow(
    gaussians: Gaussians, optimizer: Adam, wanted: int, min_opacity: float, generator: torch.Generator
) -> Gaussians:
    """Add copies of live Gaussians, drawn by opacity, until there are ``wanted`` or none can share its opacity.

    Returns:
        Gaussians attached to ``optimizer``; ``gaussians`` itself if none is added.
    """
    missing = wanted - gaussians.count
    if missing <= 0:
        return gaussians
    live = alive(gaussians, min_opacity)
    hosts = draw_hosts(gaussians.opacities, live, missing, min_opacity, generator)
    _share(gaussians, optimizer, hosts)
    return replace_rows(gaussians, optimizer, torch.ones_like(live), gaussians.select(hosts))


def alive(gaussians: Gaussians, min_opacity: float) -> Tensor:
    """(N,) bool: finite and more opaque than ``min_opacity``."""
    return gaussians.finite() & (gaussians.opacities > min_opacity)


def add_noise(gaussians: Gaussians, factor: float, min_opacity: float, generator: torch.Generator) -> None:
    """Move the means randomly, in place: ``factor * gate * covariance @ normal``.

    The gate ``sigmoid(-100 (opacity - min_opacity))`` keeps opaque Gaussians in place.

    Args:
        factor: noise learning rate times the learning rate of the means.
        min_opacity: opacity at which the gate is 0.5.
    """
    raw = gaussians.detach()
    gate = torch.sigmoid(-_GATE_STEEPNESS * (raw.opacities - min_opacity))
    drawn = random_normal(raw.means, generator) * (gate * factor)[:, None]
    rotation = rotation_matrices(raw.quats)
    # Covariance R S² Rᵀ times the normal, without forming the matrix.
    local = (rotation.mT @ drawn[:, :, None]) * raw.scales.square()[:, :, None]
    noise = (rotation @ local)[:, :, 0]
    # A diverged scale must not move the mean to infinity.
    raw.means.add_(torch.where(noise.isfinite(), noise, 0.0))


def _share(gaussians: Gaussians, optimizer: Adam, hosts: Tensor) -> None:
    """Set opacity and scale of the rows ``hosts`` (M,) to those shared with one copy per mention."""
    copies = torch.bincount(hosts, minlength=gaussians.count)[hosts] + 1
    raw = gaussians.detach()
    opacity, factor = relocated(raw.opacities[hosts], copies)
    raw.logit_opacities[hosts] = opacity.logit().float()
    raw.log_scales[hosts] = raw.log_scales[hosts] + factor.log().float()[:, None]
    for name in gaussians.parameters():
        optimizer.reset_moments(name, hosts)


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
    # The paper has no limit of copies per host. Without one, a few live Gaussians that receive many dead ones would all
    # get opacities below ``min_opacity`` and die.
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

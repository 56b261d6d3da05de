"""3D Gaussian splatting as Markov chain Monte Carlo (Kheradmand et al. 2024).

Instead of cloning, splitting and pruning by thresholds: dead Gaussians (opacity at most ``min_opacity``) move
onto live ones that are drawn by opacity, the number grows by 5 % a step up to a cap, and noise in every
iteration lets Gaussians explore (stochastic gradient Langevin dynamics). The loss must contain
``opacity_reg`` times the mean opacity and ``scale_reg`` times the mean scale, which let Gaussians die.
"""

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from egosplat.gaussians.model import Gaussians, rotation_matrices
from egosplat.gaussians.optimizer import Adam
from egosplat.gaussians.population import random_normal, replace_rows
from egosplat.gaussians.relocation import draw_hosts, relocated
from egosplat.gaussians.schedule import Schedule

_GATE_STEEPNESS = 100.0
"""k of the paper: how sharply noise ends above ``min_opacity``."""


@dataclass(frozen=True)
class McmcOptions:
    """Numbers of 3DGS-MCMC; the defaults are the paper's.

    Attributes:
        max_gaussians: cap of the number.
        min_opacity: up to this opacity a Gaussian is dead.
        growth: share of Gaussians that is added in a step, up to the cap.
        noise_lr: factor of the noise, on top of the learning rate of the means.
        opacity_reg, scale_reg: weights of the mean opacity and the mean scale in the loss.
    """

    max_gaussians: int
    min_opacity: float = 0.005
    growth: float = 0.05
    noise_lr: float = 5e5
    opacity_reg: float = 0.01
    scale_reg: float = 0.01


class Mcmc:
    """The ``Population`` of 3DGS-MCMC; give it a schedule scaled from ``STOCK_MCMC``."""

    def __init__(self, options: McmcOptions, schedule: Schedule) -> None:
        self.options = options
        self.schedule = schedule
        self.opacity_reg = options.opacity_reg
        self.scale_reg = options.scale_reg

    def observe(self, means2d_grad: Tensor | None, radii: Tensor, width: int, height: int) -> None:
        """Nothing: where Gaussians go depends on their opacities alone. See ``Population.observe``."""

    @torch.no_grad()
    def step(
        self, iteration: int, gaussians: Gaussians, optimizer: Adam, generator: torch.Generator
    ) -> Gaussians:
        """Relocate and grow when the schedule says so, and add noise always. See ``Population.step``."""
        options = self.options
        if self.schedule.densifies(iteration):
            relocate(gaussians, optimizer, options.min_opacity, generator)
            wanted = min(math.ceil((1.0 + options.growth) * gaussians.count), options.max_gaussians)
            gaussians = grow(gaussians, optimizer, wanted, options.min_opacity, generator)
        add_noise(gaussians, options.noise_lr * optimizer.means_lr, options.min_opacity, generator)
        return gaussians

    def state_dict(self) -> dict[str, Any]:
        """Empty: there is nothing to remember."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Nothing to do."""


def relocate(gaussians: Gaussians, optimizer: Adam, min_opacity: float, generator: torch.Generator) -> None:
    """Move dead Gaussians, and those that are not finite, onto live ones, in place.

    As in the paper, the live ones start with zero moments, so that they stay where they do well, and the moved
    ones keep theirs, so that they explore. Dead ones that no live one can take stay where they are.

    Raises:
        UserError: there are Gaussians and none is live.
    """
    live = alive(gaussians, min_opacity)
    if bool(live.all()):
        return
    broken = ~gaussians.finite()
    # What is not finite goes first, in case that there is not room for all.
    dead = torch.cat([index.nonzero().squeeze(1) for index in (broken, ~live & ~broken)])
    hosts = draw_hosts(gaussians.opacities, live, len(dead), min_opacity, generator)
    _share(gaussians, optimizer, hosts)
    for tensor in gaussians.detach().parameters().values():
        tensor[dead[: len(hosts)]] = tensor[hosts]
    for name in gaussians.parameters():
        # A moment may be large where the parameter has just become not finite.
        optimizer.reset_moments(name, broken)


def grow(
    gaussians: Gaussians, optimizer: Adam, wanted: int, min_opacity: float, generator: torch.Generator
) -> Gaussians:
    """Add copies of live Gaussians, drawn by opacity, until there are ``wanted`` or no live one can share.

    Returns:
        The Gaussians to go on with, attached to ``optimizer``; ``gaussians`` where none is added.
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
    """Move the means at random, in place: ``factor * gate * covariance @ normal``.

    The gate ``sigmoid(-100 (opacity - min_opacity))`` lets opaque Gaussians rest.

    Args:
        factor: noise learning rate times the learning rate of the means.
        min_opacity: opacity at which the gate is half open.
    """
    raw = gaussians.detach()
    gate = torch.sigmoid(-_GATE_STEEPNESS * (raw.opacities - min_opacity))
    drawn = random_normal(raw.means, generator) * (gate * factor)[:, None]
    rotation = rotation_matrices(raw.quats)
    local = (rotation.mT @ drawn[:, :, None]) * raw.scales.square()[:, :, None]
    noise = (rotation @ local)[:, :, 0]
    # A scale that has run away must not take the mean to infinity with it.
    raw.means.add_(torch.where(noise.isfinite(), noise, 0.0))


def _share(gaussians: Gaussians, optimizer: Adam, hosts: Tensor) -> None:
    """Give the rows at ``hosts`` (M,) the opacity and scale that they share with one copy for each mention."""
    copies = torch.bincount(hosts, minlength=gaussians.count)[hosts] + 1
    raw = gaussians.detach()
    opacity, factor = relocated(raw.opacities[hosts], copies)
    raw.logit_opacities[hosts] = opacity.logit().float()
    raw.log_scales[hosts] = raw.log_scales[hosts] + factor.log().float()[:, None]
    for name in gaussians.parameters():
        optimizer.reset_moments(name, hosts)

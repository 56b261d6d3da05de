"""Density control of 3DGS (Kerbl et al. 2023, section 5): clone, split, prune, reset opacities.

Opacity resets and the rasterizer's cutoff. A Gaussian gets gradient only from pixels where its alpha is
1/255 at least, that is within sqrt(2 ln(255 o)) standard deviations, which hold the share 1 - 1 / (255 o)
of its footprint. After 3DGS's reset to o = 0.01 that is 61 %: a Gaussian that others cover in its middle, or
that antialiasing dims, may have no such pixel left, and then neither fades nor recovers for the rest of
the run. Therefore:
    - opacities are reset to ``reset_opacity`` = 0.05 (92 % of the footprint);
    - the Adam moments of the opacities are zeroed, so that old momentum drives none below the cutoff;
    - ``prune_opacity`` must be above 1/255: what drifts down to the cutoff is pruned, not left for ever;
    - one interval of density control follows every reset (``Schedule.resets_opacity``).

Pruning by size. 3DGS takes the spread of the cameras for the size of the scene. Around a head that only turns
that is wrong, and a tenth of it would prune every Gaussian of a far wall. Here pruning by size also spares
what is at most 10 times as large as the median Gaussian, so that it takes outliers alone.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from egosplat.gaussians.model import Gaussians, rotation_matrices
from egosplat.gaussians.optimizer import Adam
from egosplat.gaussians.population import random_normal, replace_rows
from egosplat.gaussians.schedule import Schedule
from egosplat.rasterize.contract import ALPHA_THRESHOLD

_CHILDREN = 2
_SHRINK = 0.8 * _CHILDREN
"""A split Gaussian becomes two, each with its scales divided by 1.6."""


_OUTLIER = 10.0
"""Size pruning spares what is no larger than this many times the median Gaussian."""


@dataclass(frozen=True)
class DensityOptions:
    """Thresholds of density control; the defaults are 3DGS's but for ``reset_opacity``.

    Attributes:
        max_gaussians: budget: density control never grows beyond it.
        grow_grad2d: mean gradient of the image position, in units of half the image, that makes one grow.
        percent_dense: largest scale up to which a Gaussian is cloned rather than split [scene extent].
        prune_opacity: what is less opaque is pruned; above 1/255.
        prune_scale: after the first reset, what is larger is pruned [scene extent], if it is an outlier.
        prune_screen_px: the same for the radius on screen [px]; None for never.
        reset_opacity: largest opacity after a reset.

    Raises:
        ValueError: not 1/255 < prune_opacity < reset_opacity < 1.
    """

    max_gaussians: int
    grow_grad2d: float = 2e-4
    percent_dense: float = 0.01
    prune_opacity: float = 0.005
    prune_scale: float = 0.1
    prune_screen_px: float | None = None
    reset_opacity: float = 0.05

    def __post_init__(self) -> None:
        if not ALPHA_THRESHOLD < self.prune_opacity < self.reset_opacity < 1.0:
            raise ValueError(
                f"not in order: 1/255, prune_opacity {self.prune_opacity}, reset_opacity {self.reset_opacity}, 1"
            )


class DensityControl:
    """The ``Population`` of 3DGS: grows where image positions have large gradients."""

    opacity_reg = 0.0
    scale_reg = 0.0

    def __init__(self, options: DensityOptions, schedule: Schedule, extent: float) -> None:
        """``extent``: see ``egosplat.gaussians.initialization.scene_extent`` [m]."""
        self.options = options
        self.schedule = schedule
        self.extent = extent
        self._statistics: dict[str, Tensor] = {}

    @torch.no_grad()
    def observe(self, means2d_grad: Tensor | None, radii: Tensor, width: int, height: int) -> None:
        """See ``Population.observe``. A gradient that is not finite is left out.

        Raises:
            ValueError: a shape that does not fit, or another number of Gaussians than at the last call.
        """
        if means2d_grad is None:
            return
        if radii.shape != means2d_grad.shape or radii.ndim != 3:
            raise ValueError(f"gradients {tuple(means2d_grad.shape)}, radii {tuple(radii.shape)}")
        cameras, n = radii.shape[:2]
        statistics = self._statistics_of(n, radii.device)
        half_image = means2d_grad.new_tensor([width / 2, height / 2])
        norms = torch.linalg.vector_norm(means2d_grad * half_image, dim=-1) * cameras
        counted = (radii > 0).all(dim=-1) & norms.isfinite()
        statistics["grad"] += torch.where(counted, norms, 0.0).sum(dim=0)
        statistics["views"] += counted.sum(dim=0)
        statistics["radius"] = torch.maximum(statistics["radius"], radii.amax(dim=(0, 2)).float())
        self._statistics = statistics

    @torch.no_grad()
    def step(
        self, iteration: int, gaussians: Gaussians, optimizer: Adam, generator: torch.Generator
    ) -> Gaussians:
        """Grow, prune and reset when the schedule says so. See ``Population.step``."""
        if self.schedule.densifies(iteration):
            gaussians = self._densify(iteration, gaussians, optimizer, generator)
        if self.schedule.resets_opacity(iteration):
            reset_opacities(gaussians, optimizer, self.options.reset_opacity)
        return gaussians

    def state_dict(self) -> dict[str, Any]:
        """See ``Population.state_dict``."""
        return {name: tensor.clone() for name, tensor in self._statistics.items()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """See ``Population.load_state_dict``."""
        self._statistics = {name: tensor.clone() for name, tensor in state.items()}

    def _statistics_of(self, n: int, device: torch.device) -> dict[str, Tensor]:
        """(n,) float32 each: sum of gradients, number of views, largest radius [px], since the last growth."""
        if not self._statistics:
            return {name: torch.zeros(n, device=device) for name in ("grad", "views", "radius")}
        if len(self._statistics["grad"]) != n:
            raise ValueError(f"{n} Gaussians after observing {len(self._statistics['grad'])}")
        # A checkpoint may have been loaded to another device.
        return {name: tensor.to(device) for name, tensor in self._statistics.items()}

    def _densify(
        self, iteration: int, gaussians: Gaussians, optimizer: Adam, generator: torch.Generator
    ) -> Gaussians:
        options, statistics = self.options, self._statistics_of(gaussians.count, gaussians.means.device)
        # The statistics are of the Gaussians as they were: they start anew for what comes out.
        self._statistics = {}
        keep = gaussians.finite() & (gaussians.opacities >= options.prune_opacity)
        score = statistics["grad"] / statistics["views"].clamp(min=1.0)
        room = options.max_gaussians - int(keep.sum())
        grow = highest(score, keep & (score > options.grow_grad2d), room)
        clone, split = clone_or_split(gaussians, grow, options.percent_dense * self.extent)
        children = split_gaussians(gaussians.select(split), generator)
        new = Gaussians.concatenate([gaussians.select(clone), children])
        old_radius = statistics["radius"][keep & ~split]
        radius = torch.cat([old_radius, old_radius.new_zeros(new.count)])
        gaussians = replace_rows(gaussians, optimizer, keep & ~split, new)
        if self.schedule.prunes_large(iteration):
            large = too_large(gaussians, radius, options.prune_scale * self.extent, options.prune_screen_px)
            gaussians = replace_rows(gaussians, optimizer, ~large)
        return gaussians


def highest(score: Tensor, candidates: Tensor, room: int) -> Tensor:
    """(N,) bool: those of the ``candidates`` (N,) bool with the highest ``score`` (N,), ``room`` at most."""
    if int(candidates.sum()) <= room:
        return candidates
    order = torch.where(candidates, score, -math.inf).argsort(descending=True, stable=True)
    result = torch.zeros_like(candidates)
    result[order[: max(room, 0)]] = True
    return result


def clone_or_split(gaussians: Gaussians, grow: Tensor, largest_clone: float) -> tuple[Tensor, Tensor]:
    """Part ``grow`` (N,) bool into those to clone, no axis longer than ``largest_clone`` [m], and to split."""
    small = gaussians.scales.amax(dim=1) <= largest_clone
    return grow & small, grow & ~small


def split_gaussians(parents: Gaussians, generator: torch.Generator) -> Gaussians:
    """Two children for each of M parents: centres drawn from the parent, scales divided by 1.6.

    Returns:
        2 M Gaussians, a first child of every parent before the second ones.
    """
    children = Gaussians.concatenate([parents] * _CHILDREN)
    local = random_normal(children.means, generator) * children.scales
    offsets = (rotation_matrices(children.quats) @ local[:, :, None])[:, :, 0]
    return replace(
        children, means=children.means + offsets, log_scales=children.log_scales - math.log(_SHRINK)
    )


def too_large(
    gaussians: Gaussians, radius: Tensor, largest_scale: float, largest_radius: float | None
) -> Tensor:
    """(N,) bool: what is too large in the world or on screen.

    Args:
        gaussians: N of them.
        radius: (N,) largest radius on screen [px].
        largest_scale: of the longest axis [m]; or 10 times its median over all, where that is more.
        largest_radius: of ``radius``; None for any.
    """
    longest = gaussians.detach().scales.amax(dim=1)
    if not len(longest):
        return torch.zeros_like(longest, dtype=torch.bool)
    large = longest > max(largest_scale, _OUTLIER * float(longest.median()))
    return large if largest_radius is None else large | (radius > largest_radius)


def reset_opacities(gaussians: Gaussians, optimizer: Adam, largest: float) -> None:
    """Lower every opacity to ``largest`` at most, in place, and forget the Adam moments of the opacities."""
    gaussians.logit_opacities.detach().clamp_(max=math.log(largest / (1.0 - largest)))
    optimizer.reset_moments("logit_opacities")

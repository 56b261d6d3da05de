"""Density control of 3DGS (Kerbl et al. 2023, section 5): clone, split, prune, reset opacities. It deviates
from 3DGS in the opacity after a reset and in pruning by size (docs/method.md#density-control)."""

import math
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from egosplat.errors import UserError
from egosplat.gaussians.model import Gaussians, rotations
from egosplat.gaussians.optimizer import Adam
from egosplat.gaussians.schedule import TrainingOptions

_CHILDREN = 2
# A split replaces a Gaussian by two with scales divided by 1.6.
_SHRINK = 0.8 * _CHILDREN

# Pruning by size spares Gaussians up to this multiple of the median size. 3DGS takes the spread of the cameras as the
# size of the scene. If a head only turns, a tenth of that spread would prune every Gaussian of a far wall.
_OUTLIER = 10.0


# Longest axis that is cloned rather than split, and from which outliers are pruned after the first reset [scene extent].
_PERCENT_DENSE, _PRUNE_SCALE = 0.01, 0.1

# Less opaque Gaussians are pruned. Above the rasterizer's 1/255, below which a Gaussian has no gradient any more.
_PRUNE_OPACITY = 0.005


class DensityControl:
    """Decides after each iteration which Gaussians exist: grows those with large image position gradients."""

    def __init__(self, options: TrainingOptions, extent: float) -> None:
        """Take the options of the training and ``scene_extent`` [m]."""
        self.options, self.schedule, self.extent = options, options.schedule, extent
        self._statistics: dict[str, Tensor] = {}

    @torch.no_grad()
    def observe(self, means2d_grad: Tensor | None, radii: Tensor, width: int, height: int) -> None:
        """Collect the statistics of one iteration; called after ``backward``, before ``step``. ``means2d_grad``: (1, N, 2)
        float32 gradient by means2d [1/px]; None if the loss depends on no Gaussian. Values that are not finite are
        skipped. ``radii``: (1, N, 2) int32 screen radii of the rasterizer [px]; 0 if culled."""
        if means2d_grad is None:
            return
        statistics = self._statistics_of(radii.shape[1], radii.device)
        half_image = means2d_grad.new_tensor([width / 2, height / 2])
        # In units of half the image, as in 3DGS.
        norms = torch.linalg.vector_norm(means2d_grad * half_image, dim=-1)
        # A culled Gaussian has radius 0 and no gradient; counting that view would lower its mean.
        counted = (radii.amin(dim=-1) > 0) & norms.isfinite()
        statistics["grad"] += torch.where(counted, norms, 0.0).sum(dim=0)
        statistics["views"] += counted.sum(dim=0)
        statistics["radius"] = torch.maximum(statistics["radius"], radii.amax(dim=(0, 2)).float())
        self._statistics = statistics

    @torch.no_grad()
    def step(
        self, iteration: int, gaussians: Gaussians, optimizer: Adam, generator: torch.Generator
    ) -> Gaussians:
        """Grow, prune and reset when scheduled; called after the optimizer's step of ``iteration``, counted
        from 1. UserError: no Gaussian would be left. Returns Gaussians attached to ``optimizer``; the same
        object if no row was added or removed."""
        if self.schedule.densifies(iteration):
            gaussians = self._densify(iteration, gaussians, optimizer, generator)
        if self.schedule.resets_opacity(iteration):
            reset_opacities(gaussians, optimizer, self.options.reset_opacity)
        return gaussians

    def state_dict(self) -> dict[str, Any]:
        """Return copies of the statistics by name, for ``load_state_dict``."""
        return {name: tensor.clone() for name, tensor in self._statistics.items()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the statistics from ``state_dict``; its tensors are on the device of the Gaussians."""
        self._statistics = {name: tensor.clone() for name, tensor in state.items()}

    def _statistics_of(self, n: int, device: torch.device) -> dict[str, Tensor]:
        """Return (n,) float32 each: sum of gradients, number of views, largest radius [px], since the last growth."""
        names = ("grad", "views", "radius")
        return self._statistics or {name: torch.zeros(n, device=device) for name in names}

    def _densify(
        self, iteration: int, gaussians: Gaussians, optimizer: Adam, generator: torch.Generator
    ) -> Gaussians:
        options, statistics = self.options, self._statistics_of(gaussians.count, gaussians.means.device)
        # Rows change below: the next interval collects new statistics.
        self._statistics = {}
        # Pruning comes first: it frees room in the budget for growth.
        keep = gaussians.finite() & (gaussians.opacities >= _PRUNE_OPACITY)
        score = statistics["grad"] / statistics["views"].clamp(min=1.0)
        room = options.max_gaussians - int(keep.sum())
        grow = highest(score, keep & (score > options.grow_grad2d), room)
        clone, split = clone_or_split(gaussians, grow, _PERCENT_DENSE * self.extent)
        children = split_gaussians(gaussians.select(split), generator)
        new = Gaussians.concatenate([gaussians.select(clone), children])
        old_radius = statistics["radius"][keep & ~split]
        # New Gaussians have not been rendered yet: radius 0 spares them.
        radius = torch.cat([old_radius, old_radius.new_zeros(new.count)])
        gaussians = replace_rows(gaussians, optimizer, keep & ~split, new)
        if self.schedule.prunes_large(iteration):
            large = too_large(gaussians, radius, _PRUNE_SCALE * self.extent, options.prune_screen_px)
            gaussians = replace_rows(gaussians, optimizer, ~large)
        return gaussians


def highest(score: Tensor, candidates: Tensor, room: int) -> Tensor:
    """Return the (N,) bool ``candidates`` with the highest ``score`` (N,), at most ``room`` of them."""
    if int(candidates.sum()) <= room:
        return candidates
    # Stable, so that equal scores give the same choice in every run.
    order = torch.where(candidates, score, -math.inf).argsort(descending=True, stable=True)
    result = torch.zeros_like(candidates)
    result[order[: max(room, 0)]] = True
    return result


def clone_or_split(gaussians: Gaussians, grow: Tensor, largest_clone: float) -> tuple[Tensor, Tensor]:
    """Split ``grow`` (N,) bool into Gaussians to clone (no axis longer than ``largest_clone`` [m]) and to split."""
    small = gaussians.scales.amax(dim=1) <= largest_clone
    return grow & small, grow & ~small


def split_gaussians(parents: Gaussians, generator: torch.Generator) -> Gaussians:
    """2 M children of M parents, the first of each, then the second: centers drawn from the parent, scales divided by 1.6."""
    # Children keep the parent's opacity and colors, as in 3DGS.
    children = Gaussians.concatenate([parents] * _CHILDREN)
    means = children.means
    if means.device.type == "cuda":
        # A GPU draws them itself, from a seed: copying them would take longer than an iteration.
        seed = int(torch.randint(2**62, (), generator=generator))
        generator = torch.Generator(means.device).manual_seed(seed)
    local = children.scales * torch.randn(means.shape, generator=generator, device=generator.device).to(means)
    offsets = (rotations(children.quats) @ local[:, :, None])[:, :, 0]
    return replace(children, means=means + offsets, log_scales=children.log_scales - math.log(_SHRINK))


def too_large(
    gaussians: Gaussians, radius: Tensor, largest_scale: float, largest_radius: float | None
) -> Tensor:
    """(N,) bool: Gaussians that are too large in the world or on screen. ``radius``: (N,) largest screen
    radius [px]. ``largest_scale``: limit of the longest axis [m]; 10 times the median is the limit if that is
    larger. ``largest_radius``: limit of ``radius``; None for no limit."""
    longest = gaussians.detach().scales.amax(dim=1)
    if not len(longest):
        return torch.zeros_like(longest, dtype=torch.bool)
    large = longest > max(largest_scale, _OUTLIER * float(longest.median()))
    return large if largest_radius is None else large | (radius > largest_radius)


def reset_opacities(gaussians: Gaussians, optimizer: Adam, largest: float) -> None:
    """Clamp every opacity to at most ``largest``, in place, and zero the Adam moments of the opacities."""
    gaussians.logit_opacities.detach().clamp_(max=math.log(largest / (1.0 - largest)))
    # Old momentum would drive opacities below the rasterizer's cutoff.
    optimizer.reset_moments("logit_opacities")


def replace_rows(
    gaussians: Gaussians, optimizer: Adam, keep: Tensor, new: Gaussians | None = None
) -> Gaussians:
    """Keep the rows ``keep``, (N,) bool, and append ``new`` with zero moments, in Gaussians and optimizer.
    UserError: no Gaussian would be left. Returns Leaves that require gradients, attached to ``optimizer``;
    ``gaussians`` itself if nothing changes."""
    added = new.count if new is not None else 0
    if not added and bool(keep.all()) and gaussians.count:
        return gaussians
    kept = gaussians.detach().select(keep)
    result = Gaussians.concatenate([kept, new.detach()]) if new is not None else kept
    if not result.count:
        raise UserError(
            f"splats: none of {gaussians.count} Gaussians is left to train: all were too transparent, too large "
            "or not finite; check the poses and the masks"
        )
    optimizer.replace_rows(result.requires_grad_(), keep, added)
    return result

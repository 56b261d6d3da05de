"""The training schedule: learning rate of the means, SH degree, density control; and the options of a training."""

import math
from dataclasses import dataclass, replace
from typing import Any

from egosplat.gaussians.render import BACKGROUNDS, RenderSettings

# A shorter run does not shorten these intervals, except to at most this part of the run (1/5, 1/20, 1/7):
# gradients and opacities need the same number of iterations in any run.
_LEAST_PARTS = {"densify_from": 5, "densify_every": 20, "sh_interval": 7}


@dataclass(frozen=True)
class Schedule:
    """Milestones in iterations, counted from 1; the defaults are those of 3DGS (Kerbl et al. 2023).

    Attributes:
        densify_from, densify_until, densify_every: density control runs strictly between the first two, at this interval.
        reset_every: iterations between two opacity resets; None for no resets.
        reset_at_start: also reset at ``densify_from``, as 3DGS does with a white background.
        sh_interval: iterations after which the SH degree increases by one.
        position_lr_init, position_lr_final: learning rate of the means at the start and from
            ``position_lr_steps`` on, per unit of scene extent.
    """

    iterations: int = 30_000
    densify_from: int = 500
    densify_until: int = 15_000
    densify_every: int = 100
    reset_every: int | None = 3_000
    reset_at_start: bool = False
    sh_interval: int = 1_000
    position_lr_init: float = 1.6e-4
    position_lr_final: float = 1.6e-4 / 100
    position_lr_steps: int = 30_000

    def position_lr(self, iteration: int, extent: float) -> float:
        """Return the learning rate of the means [m]: log-linear from ``position_lr_init`` to ``position_lr_final``."""
        progress = min(max(iteration / self.position_lr_steps, 0.0), 1.0)
        start, end = math.log(self.position_lr_init), math.log(self.position_lr_final)
        return extent * math.exp(start + progress * (end - start))

    def sh_degree(self, iteration: int, highest: int) -> int:
        """Return the active SH degree: 0 at first, one more after each ``sh_interval``, at most ``highest``."""
        return min(iteration // self.sh_interval, highest)

    def densifies(self, iteration: int) -> bool:
        """Whether density control grows and prunes after this iteration."""
        return self.densify_from < iteration < self.densify_until and iteration % self.densify_every == 0

    def resets_opacity(self, iteration: int) -> bool:
        """Whether opacities are reset after this iteration (3DGS: 3,000, 6,000, 9,000 and 12,000)."""
        if self.reset_every is None:
            return False
        if self.reset_at_start and 0 < iteration == self.densify_from < self.densify_until:
            return True
        # A reset needs one whole interval of density control after it, in which Gaussians recover or are pruned.
        last = self.densify_until - self.reset_every
        return 0 < iteration <= last and iteration % self.reset_every == 0

    def prunes_large(self, iteration: int) -> bool:
        """Whether density control also prunes by size: after the first regular opacity reset, as in 3DGS."""
        # Never in a run without resets: large Gaussians are background as often as floaters, and there is little time
        # to grow them again.
        if self.reset_every is None or not self.resets_opacity(self.reset_every):
            return False
        return iteration > self.reset_every


# 3DGS: 30,000 iterations, density control in the first half.
STOCK = Schedule()


def scaled(schedule: Schedule, iterations: int) -> Schedule:
    """Scale a schedule to a run of at least 1 iteration. The end of density control and the learning rate
    keep their fraction of the run. Intervals grow with a longer run but do not shrink with a shorter one,
    unless they would be most of it."""
    # Shorter intervals would do harm: a gradient averaged over 25 views instead of 100 multiplies Gaussians before
    # they have moved, and opacities need their 3,000 iterations to recover from a reset. A run of fewer than
    # 12,000 iterations therefore has no reset.
    longer = max(iterations, schedule.iterations)

    def part(milestone: int) -> int:
        return max(milestone * iterations // schedule.iterations, 1)

    def interval(name: str) -> int:
        stock = getattr(schedule, name) * longer // schedule.iterations
        return min(stock, max(iterations // _LEAST_PARTS[name], 1))

    return replace(
        schedule,
        iterations=iterations,
        densify_from=interval("densify_from"),
        densify_until=max(part(schedule.densify_until), interval("densify_from")),
        densify_every=interval("densify_every"),
        reset_every=schedule.reset_every and schedule.reset_every * longer // schedule.iterations,
        sh_interval=interval("sh_interval"),
        position_lr_steps=part(schedule.position_lr_steps),
    )


def cut(schedule: Schedule, iterations: int) -> Schedule:
    """Truncate a schedule after ``iterations``, at least 1; milestones and learning rates stay."""
    return replace(
        schedule,
        iterations=iterations,
        densify_from=min(schedule.densify_from, iterations),
        densify_until=min(schedule.densify_until, iterations),
    )


# What the recipe of the paper trains otherwise than the defaults of ``TrainingOptions``; as 3DGS and EgoLifter, but for SSIM.
PAPER = {"densify_init": False, "ssim_lambda": 0.0, "prune_screen_px": 20.0}
PAPER |= {"reset_opacity": 0.01, "reset_at_start": True}


@dataclass(frozen=True, kw_only=True)
class TrainingOptions:
    """Options of one training run.

    Attributes:
        max_gaussians: largest number of Gaussians; ``max_points``: of points to start from.
        densify_init: start also where views show no point.
        sh_degree: highest degree of spherical harmonics.
        grow_grad2d: mean image position gradient above which a Gaussian grows, in units of half the image; the default is 3DGS's.
        reset_opacity: largest opacity after a reset.
        reset_at_start: also reset opacities when density control begins.
        prune_screen_px: screen radius above which Gaussians are pruned after the first regular reset [px]; None for no limit.
        ssim_lambda: share of 1 - SSIM in the loss; L1 has the rest.
        cuts_schedule: truncate the schedule of 3DGS at ``iterations``; else scale its milestones.
        evaluate_every: iterations between two evaluations.
    """

    render: RenderSettings
    iterations: int
    max_gaussians: int
    evaluate_every: int
    seed: int
    max_points: int = 50_000
    densify_init: bool = True
    sh_degree: int = 0
    grow_grad2d: float = 2e-4
    # 3DGS: 0.01. The rasterizer skips pixels with alpha below 1/255, so a Gaussian of opacity o has gradients within
    # sqrt(2 ln(255 o)) standard deviations: the fraction 1 - 1 / (255 o) of its footprint. At 0.01 that is 61 %, and a
    # Gaussian that is covered or dimmed by antialiasing may have no such pixel: it would neither fade nor recover. At
    # 0.05 it is 92 %.
    reset_opacity: float = 0.05
    reset_at_start: bool = False
    prune_screen_px: float | None = None
    ssim_lambda: float = 0.2
    cuts_schedule: bool = False

    @staticmethod
    def of(keys: Any, recipe: str = "own", **others: Any) -> "TrainingOptions":
        """Take what the options of every stage that trains Gaussians have, the values of a recipe, and ``others``."""
        render = RenderSettings(keys.near_plane, BACKGROUNDS[recipe], keys.backend)
        given = {"iterations": keys.iterations, "seed": keys.seed} | (PAPER if recipe == "paper" else {})
        return TrainingOptions(render=render, **given, **others)

    @property
    def schedule(self) -> Schedule:
        """Return the schedule for ``iterations``."""
        stock = replace(STOCK, reset_at_start=self.reset_at_start)
        return (cut if self.cuts_schedule else scaled)(stock, self.iterations)

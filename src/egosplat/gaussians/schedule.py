"""What happens when in a training run: learning rate of the positions, SH degree, density control."""

import math
from dataclasses import dataclass, replace

_LEAST_PARTS = {"densify_from": 5, "densify_every": 20, "sh_interval": 7}
"""What these wait for does not get faster in a short run: they keep their stock length, up to such a part of it."""


@dataclass(frozen=True)
class Schedule:
    """Milestones in iterations, counted from 1; the defaults are those of 3DGS (Kerbl et al. 2023).

    Attributes:
        iterations: length of the run.
        densify_from, densify_until: density control happens strictly between these two.
        densify_every: iterations between two steps of density control.
        reset_every: iterations between two opacity resets; None for no resets.
        reset_at_start: also reset at ``densify_from``, as 3DGS does where the background is white.
        sh_interval: iterations after which the SH degree grows by one.
        position_lr_init, position_lr_final: learning rate of the means at the start and from
            ``position_lr_steps`` on, per unit of scene extent.

    Raises:
        ValueError: milestones out of order, or an interval or a learning rate that is not positive.
    """

    iterations: int = 30_000
    densify_from: int = 500
    densify_until: int = 15_000
    densify_every: int = 100
    reset_every: int | None = 3_000
    reset_at_start: bool = False
    sh_interval: int = 1_000
    position_lr_init: float = 1.6e-4
    position_lr_final: float = 1.6e-6
    position_lr_steps: int = 30_000

    def __post_init__(self) -> None:
        if not 0 <= self.densify_from <= self.densify_until <= self.iterations:
            raise ValueError(
                f"not in order: densify_from {self.densify_from}, densify_until {self.densify_until}, "
                f"iterations {self.iterations}"
            )
        positive = ("densify_every", "sh_interval", "position_lr_init", "position_lr_final")
        for name in (
            *positive,
            "position_lr_steps",
            *(["reset_every"] if self.reset_every is not None else []),
        ):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}, not positive")

    def position_lr(self, iteration: int, extent: float) -> float:
        """Learning rate of the means [m]: log-linear from ``position_lr_init`` to ``position_lr_final``."""
        progress = min(max(iteration / self.position_lr_steps, 0.0), 1.0)
        start, end = math.log(self.position_lr_init), math.log(self.position_lr_final)
        return extent * math.exp(start + progress * (end - start))

    def sh_degree(self, iteration: int, highest: int) -> int:
        """SH degree in use: 0 at first, one more after each ``sh_interval``, at most ``highest``."""
        return min(iteration // self.sh_interval, highest)

    def densifies(self, iteration: int) -> bool:
        """Whether density control grows and prunes after this iteration."""
        inside = self.densify_from < iteration < self.densify_until
        return inside and iteration % self.densify_every == 0

    def resets_opacity(self, iteration: int) -> bool:
        """Whether opacities are reset after this iteration.

        A reset is left out where less than one whole interval of density control would follow it: what a
        reset makes transparent needs that time to come back or to be pruned. (With the numbers of 3DGS:
        3,000, 6,000, 9,000 and 12,000.)
        """
        if self.reset_every is None:
            return False
        if self.reset_at_start and iteration == self.densify_from > 0:
            return True
        last = self.densify_until - self.reset_every
        return 0 < iteration <= last and iteration % self.reset_every == 0

    def prunes_large(self, iteration: int) -> bool:
        """Whether density control also prunes by size: after the first regular opacity reset, as in 3DGS.

        In a run without resets never: what is large there is background as often as it is a floater, and little
        time is left to grow it again.
        """
        if self.reset_every is None or not self.resets_opacity(self.reset_every):
            return False
        return iteration > self.reset_every


STOCK = Schedule()
"""3DGS: 30,000 iterations, density control in the first half."""

STOCK_MCMC = Schedule(densify_until=25_000, reset_every=None)
"""3DGS-MCMC (Kheradmand et al. 2024): relocation until 25,000 and no resets."""


def scaled(schedule: Schedule, iterations: int) -> Schedule:
    """The schedule of a run of another length, 1 iteration at least.

    The end of density control and the learning rate keep their fraction of the run. The intervals grow with
    a longer run but do not shrink with a shorter one, unless it is so short that they would be most of it:
    a gradient averaged over 25 views rather than 100 lets Gaussians multiply before they had time to move,
    and opacities need their 3,000 iterations to come back from a reset. So a run of less than 12,000
    iterations has no reset.

    Raises:
        ValueError: ``iterations`` is less than 1.
    """
    if iterations < 1:
        raise ValueError(f"a run of {iterations} iterations")
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
    """The first ``iterations`` of a schedule, its milestones and learning rates as they are.

    Raises:
        ValueError: ``iterations`` is less than 1.
    """
    if iterations < 1:
        raise ValueError(f"a run of {iterations} iterations")
    return replace(
        schedule,
        iterations=iterations,
        densify_from=min(schedule.densify_from, iterations),
        densify_until=min(schedule.densify_until, iterations),
    )

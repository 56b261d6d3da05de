"""Training options, and the schedule and density control they select."""

from dataclasses import dataclass, replace

from egosplat.gaussians.density_control import DensityControl, DensityOptions
from egosplat.gaussians.render import RenderSettings
from egosplat.gaussians.schedule import STOCK, Schedule, cut, scaled

# 3DGS's learning rate and densification threshold.
POSITION_LR = 1.6e-4
GROW_GRAD2D = 2e-4


@dataclass(frozen=True, kw_only=True)
class TrainingOptions:
    """Options of one training run.

    Attributes:
        max_gaussians: largest number of Gaussians.
        grow_grad2d: image position gradient above which a Gaussian grows.
        reset_opacity: largest opacity after a reset.
        reset_at_start: also reset opacities when density control begins.
        prune_screen_px: screen radius above which Gaussians are pruned after the first regular reset [px]; None for no limit.
        cuts_schedule: truncate the schedule of 3DGS at ``iterations``; else scale its milestones.
        evaluate_every: iterations between two evaluations.
        position_lr: initial learning rate of the means, per unit of scene extent; it decays to 1/100.
    """

    render: RenderSettings
    iterations: int
    max_gaussians: int
    grow_grad2d: float
    evaluate_every: int
    seed: int
    reset_opacity: float = 0.05
    reset_at_start: bool = False
    prune_screen_px: float | None = None
    cuts_schedule: bool = False
    position_lr: float = POSITION_LR

    @property
    def schedule(self) -> Schedule:
        """Return the schedule for ``iterations``."""
        stock = replace(STOCK, reset_at_start=self.reset_at_start)
        # 3DGS's ratio: 1.6e-4 to 1.6e-6.
        rates = {"position_lr_init": self.position_lr, "position_lr_final": self.position_lr / 100}
        fitted = cut if self.cuts_schedule else scaled
        return replace(fitted(stock, self.iterations), **rates)

    def density_control(self, extent: float) -> DensityControl:
        """Return the density control of a scene of ``extent`` [m]."""
        options = DensityOptions(
            self.max_gaussians,
            grow_grad2d=self.grow_grad2d,
            prune_screen_px=self.prune_screen_px,
            reset_opacity=self.reset_opacity,
        )
        return DensityControl(options, self.schedule, extent)

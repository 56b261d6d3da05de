"""What a training run is told: the keys of the schema's section ``splats``, grouped by who uses them."""

from dataclasses import dataclass, replace

from egosplat.gaussians.mcmc import Mcmc, McmcOptions
from egosplat.gaussians.population import Population
from egosplat.gaussians.render import RenderSettings
from egosplat.gaussians.schedule import STOCK, STOCK_MCMC, Schedule, cut, scaled
from egosplat.gaussians.strategy import DensityControl, DensityOptions


@dataclass(frozen=True)
class TrainingOptions:
    """How Gaussians are trained; see the schema for what each key trades.

    Attributes:
        render: how they are rendered.
        iterations: length of the run.
        strategy: ``default`` (3DGS) or ``mcmc`` (3DGS-MCMC).
        max_gaussians: budget.
        position_lr: learning rate of the means at the start, per unit of scene extent; it ends at 1/100 of it.
        grow_grad2d: gradient of the image position above which ``stock`` lets a Gaussian grow.
        reset_opacity: largest opacity after a reset of ``stock``.
        reset_at_start: whether ``stock`` also resets where density control begins.
        cuts_schedule: whether a run of another length than the stock schedule's ends in the middle of it, or runs on;
            else its milestones keep their fraction of the run.
        prune_screen_px: radius on screen above which ``stock`` prunes after the first regular reset [px]; None for any.
        evaluate_every: iterations between two evaluations.
        patience: evaluations without improvement that end the run; 0 for never.
        min_improvement: of the validation PSNR, to count as one; with less an SH degree is not needed [dB].
        seed: of everything random.
        searches_degree: whether SH degrees that photographs set aside do not justify are taken away.
    """

    render: RenderSettings
    iterations: int
    strategy: str
    max_gaussians: int
    position_lr: float
    grow_grad2d: float
    evaluate_every: int
    patience: int
    min_improvement: float
    seed: int
    searches_degree: bool = False
    reset_opacity: float = 0.05
    reset_at_start: bool = False
    prune_screen_px: float | None = None
    cuts_schedule: bool = False

    @property
    def schedule(self) -> Schedule:
        """The stock schedule of the kind of density control, for ``iterations``."""
        stock = STOCK_MCMC if self.strategy == "mcmc" else replace(STOCK, reset_at_start=self.reset_at_start)
        rates = {"position_lr_init": self.position_lr, "position_lr_final": self.position_lr / 100}
        fitted = cut if self.cuts_schedule else scaled
        return replace(fitted(stock, self.iterations), **rates)

    def population(self, extent: float) -> Population:
        """Density control of the kind asked for, in a scene of ``extent`` [m]."""
        if self.strategy == "mcmc":
            return Mcmc(McmcOptions(self.max_gaussians), self.schedule)
        options = DensityOptions(
            self.max_gaussians,
            grow_grad2d=self.grow_grad2d,
            prune_screen_px=self.prune_screen_px,
            reset_opacity=self.reset_opacity,
        )
        return DensityControl(options, self.schedule, extent)

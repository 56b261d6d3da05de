"""The loss that trains H and temporary Gaussians together (the paper's initialization stage)."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.gaussians.loss import Objective, l2
from egosplat.gaussians.training_views import Views
from egosplat.transient.network import TransientNet
from egosplat.transient.residual_scale import ResidualScale

# Factor on the mean over all values, by reduction over R, G, B.
CHANNELS = {"mean": 1.0, "sum": 3.0}


@dataclass(frozen=True)
class InitialOptions:
    """Training options of H.

    Attributes:
        warmup: initial iterations that train only the Gaussians.
        transient_penalty: cost of M = 1; H predicts transient pixels where the residual is larger.
        penalty_unit: ``residual`` (the penalty is a multiple of the view's ``ResidualScale.unit``) or ``absolute``.
        residual: ``mean`` or ``sum`` of the squared differences over the channels.
        lr: Adam's learning rate for H.
    """

    iterations: int
    warmup: int
    transient_penalty: float
    penalty_unit: str
    residual: str
    lr: float


class InitialObjective(Objective):
    """L_init = mean over pixels of (1 - M) d_I + penalty |M|, with d_I the squared difference.

    Attributes:
        net: H.
        residuals: of the views at their last visit in the warm-up, or at their first one after it. Empty if the penalty
            is absolute.
    """

    advice = "lower transient.lr, or raise run.near_plane"

    def __init__(self, net: TransientNet, options: InitialOptions, device: torch.device) -> None:
        """Move ``net`` to ``device``, the device of the Gaussians, and train it in place."""
        self.net = net.to(device).train()
        # Listed once: a walk through all layers takes as long as a step of Adam.
        self._weights = list(self.net.parameters())
        self._options = options
        # The tests' device has no fused step. Without it, a step on a CPU takes three times as long.
        self._adam = torch.optim.Adam(self._weights, lr=options.lr, fused=device.type in ("cpu", "cuda"))
        self._probability = torch.zeros(options.iterations, device=device)
        self._iteration = 0
        self.residuals = ResidualScale(device)

    def loss(self, image: Tensor, views: Views, index: int) -> Tensor:
        """Return L_init of one image; see ``egosplat.gaussians.loss.Objective``."""
        picture = views.picture(index)
        factor = CHANNELS[self._options.residual]
        self._iteration += 1
        # Pixels that the frame's own mask leaves out have no weight.
        shown = views.weight(index)
        self._measure(image.detach() - picture, shown, index, len(views))
        if self._warming_up:
            return factor * l2(image, picture, shown)
        probability = self.net(picture, *picture.shape[:2])
        self._probability[self._iteration - 1] = probability.detach().mean()
        # Not detached: L_init trains H through this weight.
        static = 1.0 - probability
        weight = static if shown is None else shown * static
        # Nor are they static: H is not told to call them so.
        own = None if views.transient is None else views.transient[index].to(probability.device)
        told = probability if own is None else probability.masked_fill(own, 0.0)
        # For a constant residual e of a pixel, the optimum is M = 0 if e < penalty, else 1
        # (docs/method.md#transient-loss). H only approaches it, depending on learning rate and iterations.
        return factor * l2(image, picture, weight) + self._penalty(index) * told.mean()

    def step(self) -> None:
        """Update H, except during warm-up and if a gradient is not finite."""
        if self._warming_up:
            return
        grads = [weight.grad for weight in self._weights if weight.grad is not None]
        # One step with NaN would make all later predictions NaN.
        if bool(torch.nn.utils.get_total_norm(grads).isfinite()):
            self._adam.step()
        self._adam.zero_grad()

    def mean_probability(self, iterations: list[int]) -> NDArray[np.float64]:
        """Return the mean M between consecutive ``iterations``, from iteration 0 on; 0 during warm-up."""
        ends = np.array([0, *iterations])
        means = self._probability.cpu().double().numpy()
        return np.array([means[a:b].mean() for a, b in pairwise(ends)])

    def _measure(self, difference: Tensor, shown: Tensor | None, index: int, views: int) -> None:
        if self._in_residuals and (self._warming_up or not self.residuals.has(index)):
            squared = CHANNELS[self._options.residual] * difference.square().mean(-1)
            self.residuals.measure(index, views, squared, shown)

    def _penalty(self, index: int) -> Tensor | float:
        penalty = self._options.transient_penalty
        return penalty * self.residuals.unit(index) if self._in_residuals else penalty

    def state_dict(self) -> dict[str, Any]:
        """Return H, its optimizer, the residuals, the curve and the iteration, for ``load_state_dict``."""
        return {
            "net": dict(self.net.state_dict()),
            "adam": self._adam.state_dict(),
            "probability": self._probability,
            "iteration": self._iteration,
            "residuals": self.residuals.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state from ``state_dict``."""
        self.net.load_state_dict(state["net"])
        self._adam.load_state_dict(state["adam"])
        self._probability = state["probability"]
        self._iteration = state["iteration"]
        self.residuals.load_state_dict(state["residuals"])

    @property
    def _warming_up(self) -> bool:
        return self._iteration <= self._options.warmup

    @property
    def _in_residuals(self) -> bool:
        return self._options.penalty_unit == "residual"

"""Stop training when the validation PSNR no longer improves, and keep the best Gaussians."""

import math
from dataclasses import dataclass
from typing import Any

from egosplat.gaussians.model import Gaussians


@dataclass
class EarlyStop:
    """Track the best Gaussians and the number of evaluations without improvement.

    Attributes:
        patience: consecutive evaluations without improvement that end training.
        min_improvement: smallest rise of the PSNR that counts as an improvement [dB].
        best: copy of the best Gaussians; None before the first evaluation.
        best_psnr: their PSNR [dB].
        best_iteration: the iteration that produced them.
        waited: evaluations since the last improvement.
    """

    patience: int
    min_improvement: float
    best: Gaussians | None = None
    best_psnr: float = -math.inf
    best_iteration: int = 0
    waited: int = 0
    _mark: float = -math.inf

    def observe(self, iteration: int, psnr: float, gaussians: Gaussians) -> bool:
        """Record an evaluation and return whether training should end. A PSNR of NaN is no improvement."""
        if psnr > self.best_psnr:
            self.best = Gaussians(**{name: p.detach().clone() for name, p in gaussians.parameters().items()})
            self.best_psnr, self.best_iteration = psnr, iteration
        # Compared with the last improvement that counted, so that many small improvements add up.
        improved = psnr >= self._mark + self.min_improvement
        self.waited = 0 if improved else self.waited + 1
        if improved:
            self._mark = psnr
        return self.waited >= self.patience

    def state_dict(self) -> dict[str, Any]:
        """Return the state for ``load_state_dict``."""
        return {
            "best": self.best and self.best.parameters(),
            "best_psnr": self.best_psnr,
            "best_iteration": self.best_iteration,
            "waited": self.waited,
            "mark": self._mark,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state from ``state_dict``."""
        self.best = state["best"] and Gaussians(**state["best"])
        self.best_psnr, self.best_iteration = state["best_psnr"], state["best_iteration"]
        self.waited, self._mark = state["waited"], state["mark"]

"""When to stop, and which Gaussians to keep."""

import math
from dataclasses import dataclass
from typing import Any

from egosplat.gaussians.model import Gaussians


@dataclass
class EarlyStop:
    """Keeps the best Gaussians, and says when none better came for a while.

    Attributes:
        patience: number of evaluations in a row without improvement that ends training.
        min_improvement: of the PSNR, to count as one [dB].
        best: the Gaussians to keep, a copy; None before the first evaluation.
        best_psnr: theirs [dB].
        best_iteration: when they were reached.
        waited: evaluations since the last that counted as an improvement.
    """

    patience: int
    min_improvement: float
    best: Gaussians | None = None
    best_psnr: float = -math.inf
    best_iteration: int = 0
    waited: int = 0
    _mark: float = -math.inf

    def observe(self, iteration: int, psnr: float, gaussians: Gaussians) -> bool:
        """Take note of an evaluation; True where training is to end. A PSNR of NaN is no improvement."""
        if psnr > self.best_psnr:
            self.best = Gaussians(**{name: p.detach().clone() for name, p in gaussians.parameters().items()})
            self.best_psnr, self.best_iteration = psnr, iteration
        # From the last improvement that counted, so that many small ones do count together.
        improved = psnr >= self._mark + self.min_improvement
        self.waited = 0 if improved else self.waited + 1
        if improved:
            self._mark = psnr
        return self.waited >= self.patience

    def state_dict(self) -> dict[str, Any]:
        """All that ``load_state_dict`` needs."""
        return {
            "best": self.best and self.best.parameters(),
            "best_psnr": self.best_psnr,
            "best_iteration": self.best_iteration,
            "waited": self.waited,
            "mark": self._mark,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state_dict``."""
        self.best = state["best"] and Gaussians(**state["best"])
        self.best_psnr, self.best_iteration = state["best_psnr"], state["best_iteration"]
        self.waited, self._mark = state["waited"], state["mark"]

"""The complete state of a training run, for checkpoints."""

from dataclasses import asdict, dataclass, field
from typing import Any

import torch

from egosplat.gaussians.corrections import Corrections
from egosplat.gaussians.density_control import DensityControl
from egosplat.gaussians.model import PARAMETERS, Gaussians
from egosplat.gaussians.objective import Objective
from egosplat.gaussians.optimizer import Adam, LearningRates
from egosplat.gaussians.options import TrainingOptions


@dataclass
class Curves:
    """Training curves: one list entry per record or per evaluation.

    Attributes:
        iteration, loss, gaussians: of each record: last iteration, mean loss, number of Gaussians.
        evaluated: iteration of each evaluation.
        psnr, ssim: means over the held-out views; NaN if there are none.
        seconds: training time so far; the only numbers that differ between identical runs.
    """

    iteration: list[int] = field(default_factory=list)
    loss: list[float] = field(default_factory=list)
    gaussians: list[int] = field(default_factory=list)
    evaluated: list[int] = field(default_factory=list)
    psnr: list[float] = field(default_factory=list)
    ssim: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)


class TrainingState:
    """The state of a training run after an iteration.

    Attributes:
        gaussians: leaves, attached to ``optimizer``.
        corrections: of the training views; None if neither poses nor exposure are corrected.
        order: remaining views of this epoch, the next one last.
        seconds: training time so far.
        loss_sum: sum over the iterations since the last record, on the Gaussians' device.
        bad_records: consecutive records with a loss that is not finite.
    """

    def __init__(
        self,
        start: Gaussians,
        options: TrainingOptions,
        extent: float,
        objective: Objective,
        corrections: Corrections | None = None,
    ) -> None:
        """Create the state before the first iteration; ``start`` is not copied, ``extent`` is that of the scene [m]."""
        self.gaussians = start.requires_grad_()
        # 3DGS scales only the learning rate of the means, because only means have the unit of the scene.
        self.optimizer = Adam(start, LearningRates(means=options.position_lr * extent))
        self.density: DensityControl = options.density_control(extent)
        self.objective = objective
        self.corrections = corrections
        # On the CPU: a GPU's generator would draw other numbers from the same seed.
        self.generator = torch.Generator().manual_seed(options.seed)
        self.order: list[int] = []
        self.curves = Curves()
        self.iteration = 0
        self.seconds = 0.0
        self.loss_sum = start.means.new_zeros(())
        self.bad_records = 0
        self.extent = extent

    def next_view(self, views: int) -> int:
        """Return the next view of this epoch's random permutation of so many ``views``."""
        if not self.order:
            self.order = torch.randperm(views, generator=self.generator).tolist()
        return self.order.pop()

    def state_dict(self) -> dict[str, Any]:
        """Return tensors and numbers, nested in lists and dictionaries, for ``load_state_dict``."""
        return {
            "gaussians": self.gaussians.detach().parameters(),
            "optimizer": self.optimizer.state_dict(),
            "density": self.density.state_dict(),
            "objective": self.objective.state_dict(),
            "corrections": self.corrections and self.corrections.state_dict(),
            "generator": self.generator.get_state(),
            "order": list(self.order),
            "curves": asdict(self.curves),
            "loss_sum": self.loss_sum,
            **{name: getattr(self, name) for name in _NUMBERS},
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state from ``state_dict``, on the device of the current Gaussians."""
        device = self.gaussians.means.device
        state = _moved(state, device)
        self.gaussians = Gaussians(**{name: state["gaussians"][name] for name in PARAMETERS}).requires_grad_()
        self.optimizer = Adam(self.gaussians, self.optimizer.learning_rates)
        self.optimizer.load_state_dict(state["optimizer"])
        self.density.load_state_dict(state["density"])
        self.objective.load_state_dict(state["objective"])
        if self.corrections is not None:
            self.corrections.load_state_dict(state["corrections"])
        self.generator.set_state(state["generator"].cpu())
        self.order = state["order"]
        self.curves = Curves(**state["curves"])
        self.loss_sum = state["loss_sum"]
        for name in _NUMBERS:
            setattr(self, name, state[name])


_NUMBERS = ("iteration", "seconds", "bad_records")


def _moved(value: Any, device: torch.device) -> Any:
    """Move all tensors in nested lists and dictionaries to ``device``."""
    if isinstance(value, torch.Tensor):
        return value.to(device)
    if isinstance(value, dict):
        return {key: _moved(item, device) for key, item in value.items()}
    return [_moved(item, device) for item in value] if isinstance(value, list) else value

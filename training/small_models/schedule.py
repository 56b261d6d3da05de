"""Learning rate, averaged weights and resumable state of a training run."""

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from egosplat.errors import UserError
from egosplat.files import atomic_file


def learning_rate(peak: float, step: int, steps: int, warm_up: int, decay: float) -> float:
    """Warm up, then constant, then a linear decay to one hundredth.

    The constant phase makes a longer run identical to a shorter one until the shorter one decays.

    Args:
        decay: fraction of ``steps`` at the end over which the rate falls.
    """
    left = (steps - step) / max(1, decay * steps)
    return peak * min(1.0, (step + 1) / warm_up) * max(0.01, min(1.0, left))


class Average:
    """Exponential moving average of a model's weights; these are the weights to keep."""

    def __init__(self, model: nn.Module, decay: float) -> None:
        self.decay = decay
        self.weights = {name: value.detach().clone() for name, value in model.state_dict().items()}

    @torch.no_grad()
    def update(self, model: nn.Module, step: int) -> None:
        """Add the weights after ``step``; early ones are forgotten faster."""
        share = 1 - min(self.decay, (1 + step) / (10 + step))
        for name, value in model.state_dict().items():
            if value.is_floating_point():
                self.weights[name].lerp_(value, share)
            else:
                self.weights[name].copy_(value)


def save_state(path: Path, **state: Any) -> None:
    """Write the state of a run atomically."""
    with atomic_file(path) as scratch:
        torch.save(state, scratch)


def read_state(path: Path, device: torch.device) -> dict[str, Any] | None:
    """Read what ``save_state`` wrote, or None if the file does not exist.

    Raises:
        UserError: the file cannot be read.
    """
    if not path.exists():
        return None
    try:
        return torch.load(path, map_location=device, weights_only=True)
    except Exception as error:
        raise UserError(f"{path}: not a training state ({error}); remove it to start again") from error


def half_precision(weights: dict[str, Tensor]) -> dict[str, Tensor]:
    """Weights in the distributed form: float16, contiguous, on the CPU."""
    return {
        name: (value.half() if value.is_floating_point() else value).contiguous().cpu()
        for name, value in weights.items()
    }

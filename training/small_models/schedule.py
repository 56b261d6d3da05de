"""The course of a training run: learning rate, averaged weights, and a state from which to go on."""

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from egosplat.errors import UserError
from egosplat.files import atomic_file


def learning_rate(peak: float, step: int, steps: int, warm_up: int, decay: float) -> float:
    """Rises over ``warm_up`` steps, stays, and falls in a straight line to a hundredth over the last share.

    Constant in between, so that a longer run goes the same way as a shorter one until that one's rate falls.

    Args:
        decay: share of ``steps`` at the end over which it falls.
    """
    left = (steps - step) / max(1, decay * steps)
    return peak * min(1.0, (step + 1) / warm_up) * max(0.01, min(1.0, left))


class Average:
    """Exponential moving average of a model's weights: what is kept of a training run."""

    def __init__(self, model: nn.Module, decay: float) -> None:
        self.decay = decay
        self.weights = {name: value.detach().clone() for name, value in model.state_dict().items()}

    @torch.no_grad()
    def update(self, model: nn.Module, step: int) -> None:
        """Take in the weights after ``step``; early ones are forgotten faster."""
        share = 1 - min(self.decay, (1 + step) / (10 + step))
        for name, value in model.state_dict().items():
            if value.is_floating_point():
                self.weights[name].lerp_(value, share)
            else:
                self.weights[name].copy_(value)


def save_state(path: Path, **state: Any) -> None:
    """Write everything that a run needs to go on, whole or not at all."""
    with atomic_file(path) as scratch:
        torch.save(state, scratch)


def read_state(path: Path, device: torch.device) -> dict[str, Any] | None:
    """What ``save_state`` wrote, or None where there is nothing.

    Raises:
        UserError: the file cannot be read.
    """
    if not path.exists():
        return None
    try:
        return torch.load(path, map_location=device, weights_only=True)
    except Exception as error:
        raise UserError(f"{path}: not a training state ({error}); remove it to begin anew") from error


def half_precision(weights: dict[str, Tensor]) -> dict[str, Tensor]:
    """Weights as they are shipped: float16, contiguous, on the CPU."""
    return {
        name: (value.half() if value.is_floating_point() else value).contiguous().cpu()
        for name, value in weights.items()
    }

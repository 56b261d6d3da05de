"""Adam over Gaussians whose number changes during training."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from egosplat.gaussians.model import PARAMETERS, Gaussians, as_rows
from egosplat.rasterize.kernels import library
from egosplat.rasterize.kernels.training import BETA1, BETA2, EPS, State, adam_step

# Its square is finite in float32. The square of a larger gradient would make the second moment infinite.
LARGEST_GRADIENT = 1e18


@dataclass(frozen=True)
class LearningRates:
    """Learning rates of 3DGS (Kerbl et al. 2023), of the raw parameters. ``means`` [m] is that of the start;
    later ``Adam.means_lr`` follows the schedule. ``sh_dc`` is that of SH coefficient 0, ``sh_rest`` that of
    the others."""

    means: float
    quats: float = 0.001
    log_scales: float = 0.005
    logit_opacities: float = 0.05
    sh_dc: float = 0.0025
    sh_rest: float = 0.0025 / 20
    features: float = 0.0025


class Adam:
    """Adam (Kingma & Ba 2015) with one step count for all rows, like ``torch.optim.Adam`` in 3DGS.

    A row is one Gaussian. New rows start with zero moments at the common step count. If any gradient of a row is not
    finite, the step skips that row and its moments and counts it, so that no NaN reaches the Gaussians.

    Attributes:
        gaussians: optimized in place; contiguous float32 leaves.
        means_lr: learning rate of the means [m], set by the caller before each step.
        step_count, skipped_rows: steps taken; rows skipped in all of them.
    """

    def __init__(self, gaussians: Gaussians, learning_rates: LearningRates) -> None:
        self._moments = {name: p.new_zeros(2, *p.shape) for name, p in gaussians.parameters().items()}
        self._ever_visible = torch.zeros(gaussians.count, dtype=torch.bool, device=gaussians.means.device)
        self._attach(gaussians)
        self.learning_rates, self.means_lr = learning_rates, learning_rates.means
        # 3DGS keeps the constant coefficient in a tensor of its own; here it is the first of ``sh``.
        rates = torch.full(gaussians.sh.shape[1:], learning_rates.sh_rest)
        rates[0] = learning_rates.sh_dc
        self._sh_rates = rates.flatten().to(gaussians.sh.device)
        self.step_count = self.skipped_rows = 0

    @torch.no_grad()
    def step(self, visible: Tensor | None) -> None:
        """Update all parameters from their ``grad``; a gradient of None counts as zero. ``visible`` (N,) bool
        is a superset of the rows with a gradient; None if all rows may have one. Rows that were never visible
        have zero gradient and moments; skipping them only saves time."""
        self._ever_visible |= visible if visible is not None else torch.ones_like(self._ever_visible)
        self.step_count += 1
        states = [self._state(name) for name in PARAMETERS]
        if self._ever_visible.device.type == "cpu" and library.is_usable():
            self.skipped_rows += adam_step(states, self._ever_visible, self.step_count)
        else:
            self.skipped_rows += torch_step(states, self.step_count)

    def zero_grad(self) -> None:
        """Clear all gradients."""
        for parameter in self.gaussians.parameters().values():
            parameter.grad = None

    def replace_rows(self, gaussians: Gaussians, keep: Tensor, added: int) -> None:
        """Continue with other Gaussians: those at ``keep``, (N,) bool, then ``added`` ones, whose moments
        start at zero. ValueError if a parameter is not contiguous."""
        for name, moments in self._moments.items():
            self._moments[name] = torch.stack([_with_zero_rows(each[keep], added) for each in moments])
        self._ever_visible = _with_zero_rows(self._ever_visible[keep], added)
        self._attach(gaussians)

    def reset_moments(self, name: str) -> None:
        """Zero the moments of one parameter."""
        self._moments[name].zero_()

    def state_dict(self) -> dict[str, Any]:
        """Return copies of the moments and the counters, for ``load_state_dict``."""
        return {
            "moments": {name: tensor.clone() for name, tensor in self._moments.items()},
            "ever_visible": self._ever_visible.clone(),
            "means_lr": self.means_lr,
            "step_count": self.step_count,
            "skipped_rows": self.skipped_rows,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state from ``state_dict``; the Gaussians of that state must be attached."""
        device = self.gaussians.means.device
        self._moments = {name: state["moments"][name].to(device, copy=True) for name in PARAMETERS}
        self._ever_visible = state["ever_visible"].to(device, copy=True)
        self.means_lr = state["means_lr"]
        self.step_count, self.skipped_rows = state["step_count"], state["skipped_rows"]

    def _attach(self, gaussians: Gaussians) -> None:
        for name, parameter in gaussians.parameters().items():
            if not parameter.is_contiguous():
                raise ValueError(f"{name} {tuple(parameter.shape)} is not contiguous")
        self.gaussians = gaussians

    def _state(self, name: str) -> State:
        parameter = getattr(self.gaussians, name)
        grad = torch.zeros_like(parameter) if parameter.grad is None else parameter.grad.contiguous()
        param, grad, exp_avg, exp_avg_sq = map(as_rows, (parameter.detach(), grad, *self._moments[name]))
        return param, grad, exp_avg, exp_avg_sq, self._rates(name)

    def _rates(self, name: str) -> float | Tensor:
        """Return the learning rate of a parameter; for ``sh`` one per column, (3 K,) float32."""
        if name == "means":
            return self.means_lr
        return self._sh_rates if name == "sh" else getattr(self.learning_rates, name)


def _with_zero_rows(tensor: Tensor, count: int) -> Tensor:
    return torch.cat([tensor, tensor.new_zeros(count, *tensor.shape[1:])])


def torch_step(states: Sequence[State], step: int) -> int:
    """Plain torch version of ``adam_step``, for any device."""
    broken = broken_rows([grad for _, grad, *_ in states])
    # Saved because the step below updates all rows. Rows are independent: only the broken ones need restoring.
    changed = [tensor for param, _, *moments, _ in states for tensor in (param, *moments)]
    before = [tensor[broken] for tensor in changed]
    for param, grad, exp_avg, exp_avg_sq, rates in states:
        exp_avg.lerp_(grad, 1.0 - BETA1)
        exp_avg_sq.mul_(BETA2).addcmul_(grad, grad, value=1.0 - BETA2)
        denominator = exp_avg_sq.sqrt().div_(math.sqrt(1.0 - BETA2**step)).add_(EPS)
        param.sub_((exp_avg / denominator).mul_(rates).div_(1.0 - BETA1**step))
    for tensor, kept in zip(changed, before, strict=True):
        tensor[broken] = kept
    return len(broken)


def broken_rows(grads: list[Tensor]) -> Tensor:
    """(B,) int64 rows of (N, columns) float32 tensors with a gradient that is not finite or exceeds ``LARGEST_GRADIENT``."""
    # One pass without a copy decides for nearly every step that there are none; NaN compares as False.
    extremes = [torch.aminmax(grad) for grad in grads if grad.numel()]
    sound = [(low >= -LARGEST_GRADIENT) & (high <= LARGEST_GRADIENT) for low, high in extremes]
    # One number is read for all parameters: each read makes the CPU wait for a GPU.
    if not sound or bool(torch.stack(sound).all()):
        return torch.zeros(0, dtype=torch.int64, device=grads[0].device)
    rows = torch.stack([(grad.abs() <= LARGEST_GRADIENT).all(dim=1) for grad in grads])
    return (~rows.all(dim=0)).nonzero().squeeze(1)

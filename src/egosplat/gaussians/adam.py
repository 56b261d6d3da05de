"""Adam updates of Gaussian parameters: the compiled kernel on the CPU, torch elsewhere."""

import math

import torch
from torch import Tensor

from egosplat.rasterize.kernels import library

# As in 3DGS. Epsilon is far below torch's 1e-8, because gradients of single Gaussians are tiny.
BETA1, BETA2, EPS = 0.9, 0.999, 1e-15

# Its square is finite in float32. The square of a larger gradient would make the second moment infinite.
LARGEST_GRADIENT = 1e18


def adam_step(
    param: Tensor, grad: Tensor, exp_avg: Tensor, exp_avg_sq: Tensor, rates: float | Tensor, step: int
) -> None:
    """Update ``param`` and its moments in place (Kingma & Ba 2015, algorithm 1).

    Args:
        param, grad, exp_avg, exp_avg_sq: (N, columns) float32, contiguous.
        rates: learning rate, or one for each column, (columns,) float32.
        step: step count from 1, for the bias correction.
    """
    if not _can_fuse(param):
        return torch_step(param, grad, exp_avg, exp_avg_sq, rates, step)
    from egosplat.rasterize.kernels.adam import adam_step as fused

    fused(param, grad, exp_avg, exp_avg_sq, rates, beta1=BETA1, beta2=BETA2, eps=EPS, step=step)


def torch_step(
    param: Tensor, grad: Tensor, exp_avg: Tensor, exp_avg_sq: Tensor, rates: float | Tensor, step: int
) -> None:
    """Plain torch version of ``adam_step``, for any device."""
    exp_avg.lerp_(grad, 1.0 - BETA1)
    exp_avg_sq.mul_(BETA2).addcmul_(grad, grad, value=1.0 - BETA2)
    denominator = exp_avg_sq.sqrt().div_(math.sqrt(1.0 - BETA2**step)).add_(EPS)
    param.sub_((exp_avg / denominator).mul_(rates).div_(1.0 - BETA1**step))


def broken_rows(grads: list[Tensor]) -> Tensor:
    """Return the rows with a gradient that is not finite or exceeds ``LARGEST_GRADIENT``.

    Args:
        grads: at least one (N, columns) float32 tensor, all with the same N.

    Returns:
        (B,) int64 row indices.
    """
    # One pass without a copy decides for nearly every step that there are none; NaN compares as False.
    extremes = [torch.aminmax(grad) for grad in grads if grad.numel()]
    sound = [(low >= -LARGEST_GRADIENT) & (high <= LARGEST_GRADIENT) for low, high in extremes]
    # One number is read for all parameters: each read makes the CPU wait for a GPU.
    if not sound or bool(torch.stack(sound).all()):
        return torch.zeros(0, dtype=torch.int64, device=grads[0].device)
    rows = torch.stack([(grad.abs() <= LARGEST_GRADIENT).all(dim=1) for grad in grads])
    return (~rows.all(dim=0)).nonzero().squeeze(1)


def _can_fuse(param: Tensor) -> bool:
    return param.device.type == "cpu" and library.is_usable()

"""Adam on the CPU in one pass over parameters, gradients and moments. float32."""

import torch
from torch import Tensor

from egosplat.rasterize.kernels.library import address, function


@torch.no_grad()
def adam_step(
    param: Tensor,
    grad: Tensor,
    exp_avg: Tensor,
    exp_avg_sq: Tensor,
    rates: float | Tensor,
    *,
    beta1: float,
    beta2: float,
    eps: float,
    step: int,
) -> int:
    """Update ``param`` and its moments in place, as ``torch.optim.Adam`` does (Kingma & Ba 2015, algorithm 1).

    A parameter whose gradient and moments are zero keeps its bits. A row is skipped, moments included, if one of its
    gradients is not finite or larger than 1e18. Results do not depend on the number of threads.

    Args:
        param, grad, exp_avg, exp_avg_sq: (N, columns) float32 on the CPU, contiguous; not checked.
        rates: learning rate of all columns, or (columns,) of each.
        step: number of this step, from 1, for the bias correction.

    Returns:
        Number of skipped rows.
    """
    rows, columns = param.shape
    rates = rates if isinstance(rates, Tensor) else torch.full((columns,), rates)
    # ``rates`` and the tensors stay referenced until the call returns: the kernel gets addresses only.
    addresses = map(address, (rates, param, grad, exp_avg, exp_avg_sq))
    kernel = function("adam", "liidddl" + 5 * "p", "l")
    return kernel(rows, columns, torch.get_num_threads(), beta1, beta2, eps, step, *addresses)

"""Adam on the CPU in one pass over parameters, gradients and moments. float32."""

from collections.abc import Sequence

import torch
from torch import Tensor

from egosplat.rasterize.kernels.library import address, function

# As in 3DGS. Epsilon is far below torch's 1e-8, because gradients of single Gaussians are tiny.
BETA1, BETA2, EPS = 0.9, 0.999, 1e-15

# (N, columns) parameter, gradient and both moments; the learning rate of all columns, or (columns,) of each.
State = tuple[Tensor, Tensor, Tensor, Tensor, float | Tensor]


@torch.no_grad()
def adam_step(states: Sequence[State], used: Tensor, step: int) -> int:
    """Update parameters and their moments in place, as ``torch.optim.Adam`` does (Kingma & Ba 2015, algorithm 1).

    A parameter whose gradient and moments are zero keeps its bits. A row is skipped in all parameters, moments included, if
    one of its gradients is not finite or larger than 1e18. Results do not depend on the number of threads.

    Args:
        states: of each parameter, float32 on the CPU, contiguous; not checked.
        used: (N,) bool, contiguous. Other rows have zero gradients and moments, and may be skipped.
        step: number of this step, from 1, for the bias correction.

    Returns:
        Number of skipped rows.
    """
    # The tensors stay referenced until the call returns: the kernel gets addresses only.
    tensors = [
        [*state, rates if isinstance(rates, Tensor) else torch.full(state[0].shape[1:], rates)]
        for *state, rates in states
    ]
    table = torch.tensor([[each[0].shape[1], *map(address, each)] for each in tensors])
    sizes = len(used), len(states), torch.get_num_threads()
    return function("adam", "liidddlpp", "l")(*sizes, BETA1, BETA2, EPS, step, address(table), address(used))

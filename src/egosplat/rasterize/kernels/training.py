"""What training needs of the compiled kernels beside the rasterizer: the loss, the exposure and Adam. float32."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from egosplat.rasterize.kernels.library import address, function, plain

# As in 3DGS. Epsilon is far below torch's 1e-8, because gradients of single Gaussians are tiny.
BETA1, BETA2, EPS = 0.9, 0.999, 1e-15

# (N, columns) parameter, gradient and both moments; the learning rate of all columns, or (columns,) of each.
State = tuple[Tensor, Tensor, Tensor, Tensor, float | Tensor]


def l1_ssim(render: Tensor, target: Tensor, weight: Tensor | None, ssim_lambda: float) -> Tensor:
    """The fused loss of 3DGS, value and gradient in one pass over the images: the () float32 loss of ``egosplat.gaussians.loss``, differentiable with respect to the render only.

    The result does not depend on the number of threads. The caller has checked shapes, dtypes and devices. A render that is a
    permuted view of planar (3, H, W) needs no copy.
    """
    # A detached render skips the gradient, which saves a third of the time.
    return _L1SSIM.apply(render if torch.is_grad_enabled() else render.detach(), target, weight, ssim_lambda)


class _L1SSIM(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, render: Tensor, target: Tensor, weight: Tensor | None, ssim_lambda: float
    ) -> Tensor:
        planar = render.permute(2, 0, 1).contiguous()
        inputs = planar, plain(target), plain(weight)
        gradient = torch.empty_like(planar) if ctx.needs_input_grad[0] else None
        _, height, width = planar.shape
        addresses = map(address, (*inputs, gradient))
        kernel = function("l1_ssim", "iiid" + 4 * "p", "d")
        loss = kernel(width, height, torch.get_num_threads(), ssim_lambda, *addresses)
        ctx.save_for_backward(gradient)
        return torch.tensor(loss, dtype=torch.float32)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, v_loss: Tensor) -> tuple[Tensor | None, ...]:
        (gradient,) = ctx.saved_tensors
        factor = float(v_loss)
        # The factor is nearly always 1, which saves a pass over the image.
        gradient = gradient if factor == 1.0 else gradient * factor
        return gradient.permute(1, 2, 0), None, None, None


class Expose(torch.autograd.Function):
    """The exposure of ``egosplat.gaussians.exposure`` in one pass: expose an (H, W, 3) image, fastest as a view of planar (3, H, W); ``tone`` (4,) is three logarithms of gains and the
    compression, ``picture`` the (H, W, 3) photograph or None. Differentiable by image and tone."""

    @staticmethod
    def forward(ctx: Any, image: Tensor, tone: Tensor, picture: Tensor | None) -> Tensor:
        planar = image.permute(2, 0, 1).contiguous()
        photograph = None if picture is None else plain(picture.float())
        inputs, result = (plain(tone), photograph, planar), torch.empty_like(planar)
        kernel = function("expose", "li" + 4 * "p")
        kernel(planar[0].numel(), torch.get_num_threads(), *map(address, (*inputs, result)))
        ctx.save_for_backward(*inputs)
        return result.permute(1, 2, 0)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        tone, picture, planar = ctx.saved_tensors
        v_image, v_tone = torch.empty_like(planar), torch.zeros(4, dtype=torch.float64)
        arrays = (tone, picture, planar, gradient.permute(2, 0, 1).contiguous(), v_image, v_tone)
        kernel = function("expose_backward", "li" + 6 * "p")
        kernel(planar[0].numel(), torch.get_num_threads(), *map(address, arrays))
        return v_image.permute(1, 2, 0), v_tone.float(), None


@torch.no_grad()
def adam_step(states: Sequence[State], used: Tensor, step: int) -> int:
    """Update parameters and their moments in one pass, in place, as ``torch.optim.Adam`` does (Kingma & Ba 2015, algorithm 1).

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

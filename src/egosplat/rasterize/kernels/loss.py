"""The fused loss of 3DGS on the CPU: value and gradient in one pass over the images. float32."""

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from egosplat.rasterize.kernels.library import address, function, plain


def l1_ssim(render: Tensor, target: Tensor, weight: Tensor | None, ssim_lambda: float) -> Tensor:
    """The () float32 loss of ``egosplat.gaussians.loss``, differentiable with respect to the render only.

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

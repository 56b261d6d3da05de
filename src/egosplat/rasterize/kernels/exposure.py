"""The exposure of ``egosplat.gaussians.exposure`` on the CPU, in one pass over the image. float32."""

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from egosplat.rasterize.kernels.library import address, function, plain


class Expose(torch.autograd.Function):
    """Expose an (H, W, 3) image, fastest as a view of planar (3, H, W); ``tone`` (4,) is three logarithms of gains and the
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

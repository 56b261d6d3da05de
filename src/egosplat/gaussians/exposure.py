"""The exposure of a photograph: a gain of each color, a tone curve that compresses highlights, a sensor that saturates."""

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

# Colors from here on are saturated. Below 1: JPEG and resampling darken some saturated pixels.
SATURATED = 0.98

# Renders brighter than this are as bright as this to the tone curve: the square of a diverged color would overflow.
_BRIGHTEST = 10.0

# The color whose gain does not depend on the compression, so that the gradients of both hardly depend on each other.
_MIDDLE = 0.5

# The exponential of less is 0 as well, but the product of minus infinity, a gain of 0, with a gradient of 0 has no value.
_LEAST_LOG_GAIN = -1000.0


def apply_exposure(image: Tensor, log_gain: Tensor, compression: Tensor | None = None) -> Tensor:
    """Multiply the colors of an (H, W, 3 + F) image by the gains of (3,) logarithms; features stay.

    Args:
        compression: (1,) by how much the camera's tone curve compresses highlights: the gain of a color c has the
            logarithm ``log_gain * (1 + compression / 4) / (1 + compression * c**2)``. None for 0.
    """
    return _expose(image, log_gain, compression, None)


def simulate_photograph(
    image: Tensor, log_gain: Tensor, picture: Tensor, compression: Tensor | None = None
) -> Tensor:
    """Expose an (H, W, 3 + F) image for the comparison with an (H, W, 3) photograph.

    A saturated color only says that the surface is at least as bright: what exceeds it is cut off, and has no gradient.
    """
    return _expose(image, log_gain, compression, picture)


def _expose(image: Tensor, log_gain: Tensor, compression: Tensor | None, picture: Tensor | None) -> Tensor:
    compression = image.new_zeros(1) if compression is None else compression.to(image)
    log_gain = log_gain.to(image).clamp_min(_LEAST_LOG_GAIN)
    colors, features = image[..., :3], image[..., 3:]
    colors = _Exposed.apply(colors, log_gain, compression, picture)
    if not features.shape[2]:
        return colors
    # Planar, as the render: the loss is fastest with that layout.
    return torch.cat([part.permute(2, 0, 1) for part in (colors, features)]).permute(1, 2, 0)


class _Exposed(torch.autograd.Function):
    """The exposure in few passes over memory that is there already: step by step, autograd takes twice as long.

    One image has one backward pass, which uses up what the forward pass has saved.
    """

    @staticmethod
    def forward(
        ctx: Any, colors: Tensor, log_gain: Tensor, compression: Tensor, picture: Tensor | None
    ) -> Tensor:
        # The logarithm of the gain is ``log_gain * above / below``.
        below = colors.clamp_max(_BRIGHTEST)
        below.mul_(below).mul_(compression).add_(1.0)
        curve = (1.0 + compression * _MIDDLE**2) / below
        gain = (curve * log_gain).exp_()
        image = colors * gain
        ctx.kept = True
        if picture is not None:
            # In the layout of the render: sums over two layouts take several times as long.
            excess = torch.empty_like(image).copy_(picture)
            excess.masked_fill_(excess < SATURATED, torch.inf)
            torch.sub(image, excess, out=excess)
            ctx.kept = excess <= 0.0  # a color that is as bright as the photograph's keeps its gradient
            image.sub_(excess.clamp_min_(0.0))
        ctx.save_for_backward(colors, log_gain, compression, below, curve, gain)
        return image

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, v_image: Tensor) -> tuple[Tensor | None, ...]:
        colors, log_gain, compression, below, curve, gain = ctx.saved_tensors
        v_image = v_image * ctx.kept
        v_colors = v_image * gain
        v_log = v_image.mul_(colors).mul_(gain)
        v_log_gain = torch.mul(v_log, curve, out=gain).sum(dim=(0, 1))
        v_curve = v_log.mul_(log_gain)
        v_above = torch.div(v_curve, below, out=gain).sum()
        v_below = v_curve.neg_().mul_(curve.div_(below))
        limited = torch.clamp_max(colors, _BRIGHTEST, out=curve)
        v_product = torch.mul(limited, limited, out=gain).mul_(v_below).sum()
        slope = limited.mul_(2.0).mul_(colors < _BRIGHTEST)
        v_colors.add_(v_below.mul_(compression).mul_(slope))
        v_compression = (v_above * _MIDDLE**2 + v_product).expand_as(compression)
        return v_colors, v_log_gain, v_compression, None

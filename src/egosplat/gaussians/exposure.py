"""The exposure of a photograph: a gain of each color, a tone curve that compresses highlights, a sensor that saturates."""

import torch
from torch import Tensor

from egosplat.rasterize.kernels import library
from egosplat.rasterize.kernels.training import Expose

# Colors from here on are saturated. Below 1: JPEG and resampling darken some saturated pixels.
SATURATED = 0.98

# Renders brighter than this are as bright as this to the tone curve: the square of a diverged color would overflow.
_BRIGHTEST = 10.0

# The color whose gain does not depend on the compression, so that the gradients of both hardly depend on each other.
_MIDDLE = 0.5

# The exponential of less is 0 as well, but the product of minus infinity, a gain of 0, with a gradient of 0 has no value.
_LEAST_LOG_GAIN = -1000.0


def expose(
    image: Tensor, log_gain: Tensor, compression: Tensor | None = None, picture: Tensor | None = None
) -> Tensor:
    """Multiply the colors of an (H, W, 3 + F) render by the gains of a photograph; features stay. A color c
    has the gain ``exp(log_gain (1 + k / 4) / (1 + k c²))``. ``log_gain``: (3,) natural logarithms.
    ``compression``: (1,) k, by how much the camera's tone curve compresses highlights; None for 0.
    ``picture``: (H, W, 3) photograph to compare with. A saturated color only says that the surface is at
    least as bright: what exceeds it is cut off, and has no gradient. None cuts nothing."""
    log_gain = log_gain.to(image).clamp_min(_LEAST_LOG_GAIN)
    colors, features = image[..., :3], image[..., 3:]
    compression = log_gain.new_zeros(1) if compression is None else compression.to(image)
    suits = image.shape[2] == 3 and image.dtype == torch.float32 and image.device.type == "cpu"
    if suits and library.is_usable():
        return Expose.apply(image, torch.cat([log_gain, compression]), picture)
    curve = 1.0 + compression * colors.clamp_max(_BRIGHTEST).square()
    log_gain = log_gain * ((1.0 + compression * _MIDDLE**2) / curve)
    colors = colors * log_gain.exp()
    if picture is not None:
        # In the layout of the render: sums over two layouts take several times as long.
        picture = torch.empty_like(colors).copy_(picture)
        # A color that is as bright as the photograph's keeps its gradient.
        colors = torch.where((picture >= SATURATED) & (colors > picture), picture, colors)
    if not features.shape[2]:
        return colors
    # Planar, as the render: the loss is fastest with that layout.
    return torch.cat([part.permute(2, 0, 1) for part in (colors, features)]).permute(1, 2, 0)

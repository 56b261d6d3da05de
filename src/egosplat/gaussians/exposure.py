"""The exposure of a photograph: a gain of each colour, a tone curve that compresses highlights, a sensor that saturates."""

import torch
from torch import Tensor

# Colours from here on are saturated. Below 1: JPEG and resampling darken some saturated pixels.
SATURATED = 0.98

# Renders brighter than this are as bright as this to the tone curve: the square of a diverged colour would overflow.
_BRIGHTEST = 10.0

# The colour whose gain does not depend on the compression, so that the gradients of both hardly depend on each other.
_MIDDLE = 0.5


def exposed(image: Tensor, log_gain: Tensor, compression: Tensor | None = None) -> Tensor:
    """Multiply the colours of an (H, W, 3 + F) image by the gains of (3,) logarithms; features stay.

    Args:
        compression: (1,) by how much the camera's tone curve compresses highlights: the gain of a colour c has the
            logarithm ``log_gain * (1 + compression / 4) / (1 + compression * c**2)``. None for 0.
    """
    log_gain = log_gain.to(image)
    if compression is not None:
        brightness = image[..., :3].clamp_max(_BRIGHTEST).square()
        compression = compression.to(image)
        log_gain = log_gain * ((1.0 + compression * _MIDDLE**2) / (1.0 + compression * brightness))
    # One product over all channels keeps the memory layout of the render, for which the loss is fastest.
    return image * torch.nn.functional.pad(log_gain.exp(), (0, image.shape[2] - 3), value=1.0)


def photographed(
    image: Tensor, log_gain: Tensor, picture: Tensor, compression: Tensor | None = None
) -> Tensor:
    """Expose an (H, W, 3 + F) image for the comparison with an (H, W, 3) photograph.

    A saturated colour only says that the surface is at least as bright: what exceeds it is cut off, and has no gradient.
    """
    image = exposed(image, log_gain, compression)
    excess = torch.where(picture >= SATURATED, (image[..., :3] - picture).clamp_min(0.0), 0.0)
    return image - torch.nn.functional.pad(excess, (0, image.shape[2] - 3))

"""The exposure of a photograph: a gain of each colour, and a sensor that saturates."""

import torch
from torch import Tensor

# Colours from here on are saturated. Below 1: JPEG and resampling darken some saturated pixels.
SATURATED = 0.98


def exposed(image: Tensor, log_gain: Tensor) -> Tensor:
    """Multiply the colours of an (H, W, 3 + F) image by the gains of (3,) logarithms; features stay."""
    gain = torch.nn.functional.pad(log_gain.exp(), (0, image.shape[2] - 3), value=1.0)
    # One product over all channels keeps the memory layout of the render, for which the loss is fastest.
    return image * gain.to(image)


def photographed(image: Tensor, log_gain: Tensor, picture: Tensor) -> Tensor:
    """Expose an (H, W, 3 + F) image for the comparison with an (H, W, 3) photograph.

    A saturated colour only says that the surface is at least as bright: what exceeds it is cut off, and has no gradient.
    """
    image = exposed(image, log_gain)
    excess = torch.where(picture >= SATURATED, (image[..., :3] - picture).clamp_min(0.0), 0.0)
    return image - torch.nn.functional.pad(excess, (0, image.shape[2] - 3))

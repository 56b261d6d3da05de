"""The exposure of a photograph: a gain of each colour, a tone curve that compresses highlights, a sensor that saturates."""

import torch
import torch.nn.functional as F
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
        # Unlike that of ``clamp_max``, this gradient is computed in vectors.
        brightness = F.hardtanh(image[..., :3], -torch.inf, _BRIGHTEST).square()
        compression = compression.to(image)
        log_gain = log_gain * ((1.0 + compression * _MIDDLE**2) / (1.0 + compression * brightness))
    # One product over all channels keeps the memory layout of the render, for which the loss is fastest.
    return image * _with_features(log_gain.exp(), image, 1.0)


def photographed(
    image: Tensor, log_gain: Tensor, picture: Tensor, compression: Tensor | None = None
) -> Tensor:
    """Expose an (H, W, 3 + F) image for the comparison with an (H, W, 3) photograph.

    A saturated colour only says that the surface is at least as bright: what exceeds it is cut off, and has no gradient.
    """
    image = exposed(image, log_gain, compression)
    # In the memory layout of the render, and without a choice by a mask: either takes several times as long.
    limit = torch.empty_like(image[..., :3]).copy_(picture)
    limit.masked_fill_(limit < SATURATED, torch.inf)
    return image - _with_features(F.relu(image[..., :3] - limit), image, 0.0)


def _with_features(colours: Tensor, image: Tensor, value: float) -> Tensor:
    """Append the channels that an (H, W, 3 + F) image has more than (..., 3), filled with ``value``."""
    more = image.shape[2] - 3
    return F.pad(colours, (0, more), value=value) if more else colours

"""The exposure of a photograph as a gain of each colour."""

import torch
from torch import Tensor


def exposed(image: Tensor, log_gain: Tensor) -> Tensor:
    """Multiply the colours of an (H, W, 3 + F) image by the gains of (3,) logarithms; features stay."""
    gain = torch.nn.functional.pad(log_gain.exp(), (0, image.shape[2] - 3), value=1.0)
    # One product over all channels keeps the memory layout of the render, for which the loss is fastest.
    return image * gain.to(image)

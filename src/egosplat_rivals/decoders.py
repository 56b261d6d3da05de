"""Decoders and other small networks that a method trains."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from egosplat.codes.decoder import Decoder, apply_layers, split_layers


class Layers(nn.Module):
    """A decoder in training, without the normalization at the end.

    Attributes:
        values: all weights and biases, as ``Decoder.values``.
    """

    def __init__(self, widths: tuple[int, ...], seed: int, device: torch.device, **more: object) -> None:
        """Start from random weights of ``seed``; the other arguments are those of ``Decoder``."""
        super().__init__()
        self._described = Decoder(widths, np.zeros(0, np.float32), **more)
        self.values = nn.Parameter(_random(widths, seed).to(device))

    def forward(self, codes: Tensor) -> Tensor:
        """(..., C) codes -> (..., D)."""
        return apply_layers(codes, split_layers(self.values, self._described.widths), self._described)

    def trained(self) -> Decoder:
        """The decoder with the weights of now."""
        return replace(self._described, values=self.values.detach().cpu().numpy())


def _random(widths: tuple[int, ...], seed: int) -> Tensor:
    """Uniform weights and biases within one over the root of a layer's inputs, as PyTorch's linear layers start."""
    draw = torch.Generator().manual_seed(seed)
    sizes = [(wide * (narrow + 1), narrow) for narrow, wide in pairwise(widths)]
    parts = [(2 * torch.rand(size, generator=draw) - 1) / narrow**0.5 for size, narrow in sizes]
    return torch.cat(parts)

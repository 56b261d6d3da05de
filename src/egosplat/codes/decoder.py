"""Decode codes to features, with a decoder stored as a plain array.

A decoder is a chain of affine layers with ReLU in between, followed by normalization: the decoder of LangSplat's
autoencoder. One layer is a basis with a mean; no layer leaves codes as they are.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F

from egosplat.artifacts.reader import Artifact


@dataclass(frozen=True)
class Decoder:
    """Weights of a decoder.

    Attributes:
        widths: channels from the code to the feature, one more than there are layers.
        values: (P,) float32, for each layer the (out, in) weights, then the (out,) biases.
    """

    widths: tuple[int, ...]
    values: NDArray[np.float32]
    _layers: dict[tuple[torch.dtype, torch.device], list[tuple[Tensor, Tensor]]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def layers(self, like: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Return (out, in) weights and (out,) biases of each layer, with dtype and device of ``like``.

        Raises:
            ValueError: the number of values does not match the widths.
        """
        # Kept, because a picture is decoded in thousands of parts.
        if (kind := (like.dtype, like.device)) not in self._layers:
            self._layers[kind] = self._made_layers(like)
        return self._layers[kind]

    def _made_layers(self, like: Tensor) -> list[tuple[Tensor, Tensor]]:
        sizes = [size for narrow, wide in pairwise(self.widths) for size in (wide * narrow, wide)]
        if sum(sizes) != len(self.values):
            raise ValueError(f"widths {self.widths} need {sum(sizes)} numbers, not {len(self.values)}")
        parts = torch.from_numpy(self.values).to(like).split(sizes)
        shapes = list(pairwise(self.widths))
        return [
            (parts[2 * number].reshape(wide, narrow), parts[2 * number + 1])
            for number, (narrow, wide) in enumerate(shapes)
        ]


def decode(codes: Tensor, decoder: Decoder) -> Tensor:
    """Decode codes to features of unit norm.

    Args:
        codes: (..., C) floats. Divide rendered codes by alpha first: layers have biases.

    Returns:
        (..., D), same dtype and device; a feature that vanishes is zero.

    Raises:
        ValueError: codes have another number of channels.
    """
    if codes.shape[-1] != decoder.widths[0]:
        raise ValueError(f"codes have {codes.shape[-1]} channels, the decoder takes {decoder.widths[0]}")
    values = codes
    # ReLU stands between layers only: neither the code nor the feature is clamped.
    for number, (weights, biases) in enumerate(decoder.layers(codes)):
        values = F.linear(values if number == 0 else values.relu(), weights, biases)
    return F.normalize(values, dim=-1)


def read_decoder(features: Artifact) -> Decoder:
    """Read the decoder of a features artifact."""
    return Decoder(tuple(features.facts["decoder"]["widths"]), features.read("decoder/values"))


def decoder_metadata(decoder: Decoder) -> dict[str, Any]:
    """Return the decoder's metadata, for ``read_decoder``."""
    return {"widths": list(decoder.widths)}

"""From codes back to features, by plain numbers that an artifact can hold.

A decoder is a chain of affine layers with ReLU between them, whose result is brought to unit norm. That is the decoder
of LangSplat's autoencoder; with one layer it is a basis with a mean, with none it leaves codes as they are.
"""

from dataclasses import dataclass
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
    """The numbers of a decoder.

    Attributes:
        widths: channels from the code to the feature, one more than there are layers.
        values: (P,) float32, of each layer the (out, in) weights, then the (out,) biases.
    """

    widths: tuple[int, ...]
    values: NDArray[np.float32]

    def layers(self, like: Tensor) -> list[tuple[Tensor, Tensor]]:
        """(out, in) weights and (out,) biases of each layer, of the type and on the device of ``like``.

        Raises:
            ValueError: there are not as many numbers as the widths need.
        """
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
    """Features of unit norm.

    Of rendered codes, those of full weight: divide by alpha where a ray is not filled, because layers have biases.

    Args:
        codes: (..., C) floats.
        decoder: what they were made for.

    Returns:
        (..., D) of the same type and on the same device; zeros where a feature vanishes.

    Raises:
        ValueError: codes are of another length.
    """
    if codes.shape[-1] != decoder.widths[0]:
        raise ValueError(f"codes have {codes.shape[-1]} channels, the decoder takes {decoder.widths[0]}")
    values = codes
    for number, (weights, biases) in enumerate(decoder.layers(codes)):
        values = F.linear(values if number == 0 else values.relu(), weights, biases)
    return F.normalize(values, dim=-1)


def read_decoder(features: Artifact) -> Decoder:
    """The decoder of a features artifact."""
    return Decoder(tuple(features.facts["decoder"]["widths"]), features.read("decoder/values"))


def about(decoder: Decoder) -> dict[str, Any]:
    """What the facts say of a decoder, for ``read_decoder``."""
    return {"widths": list(decoder.widths)}

"""Decode codes to features, with a decoder stored as a plain array.

A decoder is a chain of affine layers, each followed by a named function, and a normalization at the end. With ReLU in
between it is the decoder of LangSplat's autoencoder. One layer is a basis with a mean; no layer leaves codes as they are.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F

from egosplat.artifacts.reader import Artifact

# What may follow a layer, by name; softmax is over channels.
_AFTER: dict[str, Callable[[Tensor], Tensor]] = {
    "relu": F.relu,
    "softmax": lambda values: values.softmax(dim=-1),
    "none": lambda values: values,
}

# Layers with fewer channels take less time than the search for those that are 0.
_WIDE = 64


@dataclass(frozen=True)
class Decoder:
    """Weights of a decoder (ValueError: the fields do not agree).

    Attributes:
        widths: channels from the code to the feature, one more than there are layers.
        values: (P,) float32, for each layer the (out, in) weights, then the (out,) biases.
        after: what follows each layer, ``relu``, ``softmax`` or ``none``; always none after the last. Empty: ReLU between
            layers.
        unit_input: whether the code is normalized first; a zero code stays 0.
        skips: pairs (early, late) of layers, counted from 0: what the early one passes on is added to what the late
            one passes on, both with what follows them. The last layer takes no part.
    """

    widths: tuple[int, ...]
    values: NDArray[np.float32]
    after: tuple[str, ...] = ()
    unit_input: bool = False
    skips: tuple[tuple[int, int], ...] = ()
    _layers: dict[tuple[torch.dtype, torch.device], list[tuple[Tensor, Tensor]]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        count = len(self.widths) - 1
        if self.after and (len(self.after) != count or {*self.after} - {*_AFTER} or self.after[-1] != "none"):
            raise ValueError(
                f"{count} layers cannot be followed by {self.after}; each takes one of {[*_AFTER]}, the last one none"
            )
        for early, late in self.skips:
            if not 0 <= early < late < count - 1 or self.widths[early + 1] != self.widths[late + 1]:
                raise ValueError(
                    f"layer {late} of widths {self.widths} cannot take a skip from layer {early}"
                )

    def layers(self, like: Tensor) -> list[tuple[Tensor, Tensor]]:
        """(out, in) weights and (out,) biases of each layer, with dtype and device of ``like``. Raises as ``split_layers``."""
        # Kept, because a picture is decoded in thousands of parts.
        if (kind := (like.dtype, like.device)) not in self._layers:
            self._layers[kind] = split_layers(torch.from_numpy(self.values).to(like), self.widths)
        return self._layers[kind]


def split_layers(values: Tensor, widths: tuple[int, ...]) -> list[tuple[Tensor, Tensor]]:
    """(out, in) weights and (out,) biases of each layer, views of ``values``; ValueError if their number is not the widths'."""
    sizes = [size for narrow, wide in pairwise(widths) for size in (wide * narrow, wide)]
    if sum(sizes) != len(values):
        raise ValueError(f"widths {widths} need {sum(sizes)} numbers, not {len(values)}")
    parts = values.split(sizes)
    return [
        (parts[2 * number].reshape(wide, narrow), parts[2 * number + 1])
        for number, (narrow, wide) in enumerate(pairwise(widths))
    ]


def decode(codes: Tensor, decoder: Decoder) -> Tensor:
    """Decode (..., C) codes to (..., D) features of unit norm; one that vanishes is zero. ValueError if C is not the decoder's.

    Divide rendered codes by alpha first: layers have biases.
    """
    if codes.shape[-1] != decoder.widths[0]:
        raise ValueError(f"codes have {codes.shape[-1]} channels, the decoder takes {decoder.widths[0]}")
    return F.normalize(apply_layers(codes, decoder.layers(codes), decoder), dim=-1)


def apply_layers(codes: Tensor, layers: list[tuple[Tensor, Tensor]], decoder: Decoder) -> Tensor:
    """Apply a decoder to (..., C) codes with other ``layers`` than its own, without the normalization at the end."""
    # ReLU stands between layers only: neither the code nor the feature is clamped.
    after, passed = decoder.after or ("relu",) * (len(layers) - 1) + ("none",), []
    values = F.normalize(codes, dim=-1) if decoder.unit_input else codes
    for number, (weights, biases) in enumerate(layers):
        values = _AFTER[after[number]](F.linear(*_used(values, weights), biases))
        for early, late in decoder.skips:
            if late == number:
                values = values + passed[early]
        passed.append(values)
    return values


def _used(values: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """(..., in) values without channels that are 0 in every row, and (out, in) weights without their columns."""
    # After a ReLU nearly half are 0. On a GPU it would have to wait for their number, and training to record the choice.
    narrow = values.shape[-1] < _WIDE or not values.numel()
    if narrow or values.device.type != "cpu" or torch.is_grad_enabled():
        return values, weights
    rows = values.flatten(0, -2)
    used = ((rows.amax(0) != 0) | (rows.amin(0) != 0)).nonzero()[:, 0]
    return values.index_select(-1, used), weights.index_select(1, used)


def read_decoder(artifact: Artifact) -> Decoder:
    """Read the decoder of a features artifact, or of a language artifact that has one of its own."""
    stored = artifact.facts["decoder"]
    # Widths alone describe a decoder with ReLU between layers.
    return Decoder(
        tuple(stored["widths"]),
        artifact.read("decoder/values"),
        tuple(stored.get("after", ())),
        stored.get("unit_input", False),
        tuple((early, late) for early, late in stored.get("skips", ())),
    )


def read_scene_decoder(language: Artifact, features: Artifact) -> Decoder:
    """Read the decoder of a scene's codes: that of its language artifact if it has one, else that of its features."""
    return read_decoder(language if language.has("decoder/values") else features)


def decoder_metadata(decoder: Decoder) -> dict[str, Any]:
    """Return the decoder's metadata, for ``read_decoder``."""
    return {
        "widths": list(decoder.widths),
        "after": list(decoder.after),
        "unit_input": decoder.unit_input,
        "skips": [list(pair) for pair in decoder.skips],
    }

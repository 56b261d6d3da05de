"""Decode codes to features, with a decoder stored as a plain array.

A decoder is a chain of affine layers, each followed by a named function, and a normalization at the end. With ReLU in
between it is the decoder of LangSplat's autoencoder. One layer is a basis with a mean; no layer leaves codes as they are.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from egosplat.arrays import Floats
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
    """Weights of a decoder.

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
    values: Floats
    after: tuple[str, ...] = ()
    unit_input: bool = False
    skips: tuple[tuple[int, int], ...] = ()
    _layers: dict[tuple[torch.dtype, torch.device], list[tuple[Tensor, Tensor]]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @cached_property
    def folded(self) -> tuple["Decoder", Tensor | None]:
        """A decoder to r = min(D, H + 1) channels, where H is the width of the last hidden layer, with the (D, r) float64 basis on which
        ``project`` puts directions; None for the same decoder. Inner products stay the same for every code."""
        if len(self.widths) == 1 or self.widths[-2] + 1 >= self.widths[-1]:
            return self, None
        # The last layer maps H numbers h to D channels, f = W [h; 1], so f lies in at most H + 1 dimensions. With W = Q R,
        # where the columns of Q are orthonormal, |f| = |R [h; 1]| and x·f = (Qᵀx)·(R [h; 1]): cosines need r numbers a
        # pixel, 17 in place of 512 for a linear basis of 16 codes.
        *before, hidden, channels = self.widths
        last = channels * (hidden + 1)
        weights, biases = np.split(self.values[-last:].astype(np.float64), [channels * hidden])
        q, r = np.linalg.qr(np.column_stack([weights.reshape(channels, hidden), biases]))
        values = np.concatenate([self.values[:-last], r[:, :hidden].ravel(), r[:, hidden]])
        folded = replace(self, widths=(*before, hidden, len(r)), values=values.astype(np.float32))
        return folded, torch.from_numpy(q)

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
    """Decode (..., C) codes to (..., D) features of unit norm; one that vanishes is zero. ValueError if C is
    not the decoder's. Divide rendered codes by alpha first: layers have biases."""
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
    rows = values.reshape(-1, values.shape[-1])
    used = ((rows.amax(0) != 0) | (rows.amin(0) != 0)).nonzero()[:, 0]
    return values.index_select(-1, used), weights.index_select(1, used)


def project(directions: Tensor, basis: Tensor | None) -> Tensor:
    """(K, r) coordinates of (K, D) directions on the basis of ``Decoder.folded``, usually not of unit norm."""
    if basis is None:
        return directions
    return (directions.double() @ basis.to(directions.device)).to(directions.dtype)


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


def decoder_metadata(decoder: Decoder) -> dict[str, Any]:
    """Return the decoder's metadata, for ``read_decoder``."""
    return {
        "widths": list(decoder.widths),
        "after": list(decoder.after),
        "unit_input": decoder.unit_input,
        "skips": [list(pair) for pair in decoder.skips],
    }

"""A decoder's layers, what follows them, its skips, and the checks of its fields."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from egosplat.language.decoder import Decoder, decode, decoder_metadata


def chain(*layers: tuple[list[list[float]], list[float]], **fields: object) -> Decoder:
    """A decoder of (out, in) weights and biases."""
    widths = (len(layers[0][0][0]), *(len(weights) for weights, _ in layers))
    values = np.concatenate([np.r_[np.ravel(weights), biases] for weights, biases in layers])
    return Decoder(widths, values.astype(np.float32), **fields)


EYE = ([[1.0, 0.0], [0.0, 1.0]], [0.0, 0.0])
BOOK = EYE, ([[1.0, 0.0], [0.0, 3.0]], [0.0, 0.0])
TURN = ([[0.0, -1.0], [1.0, 0.0]], [0.0, 0.0])
SHIFT = (EYE[0], [1.0, 0.0])
THREE = {"after": ("relu", "relu", "none")}
ROOT = 0.5**0.5


@pytest.mark.parametrize(
    ("decoder", "code", "feature"),
    [
        # Certain logits give their row; equal ones lean to the longer row, which is not normalized.
        (chain(*BOOK, after=("softmax", "none")), [60.0, 0.0], [1.0, 0.0]),
        (chain(*BOOK, after=("softmax", "none")), [0.0, 60.0], [0.0, 1.0]),
        (chain(*BOOK, after=("softmax", "none")), [5.0, 5.0], [10**-0.5, 3 * 10**-0.5]),
        # Without names ReLU stands between layers alone.
        (chain(EYE, EYE), [-3.0, 4.0], [0.0, 1.0]),
        (chain(EYE, EYE, after=("relu", "none")), [-3.0, 4.0], [0.0, 1.0]),
        (chain(EYE, EYE, after=("none", "none")), [-3.0, 4.0], [-0.6, 0.8]),
        # Layer 0 gives (1, 0), layer 1 turns it to (0, 1), and with a skip the sum is (1, 1).
        (chain(EYE, TURN, EYE, **THREE), [1.0, 0.0], [0.0, 1.0]),
        (chain(EYE, TURN, EYE, **THREE, skips=((0, 1),)), [1.0, 0.0], [ROOT, ROOT]),
        # A unit input has no norm, and stays 0.
        (chain(SHIFT, unit_input=True), [0.0, 1.0], [ROOT, ROOT]),
        (chain(SHIFT, unit_input=True), [0.0, 1e-3], [ROOT, ROOT]),
        (chain(SHIFT, unit_input=True), [0.0, 0.0], [1.0, 0.0]),
    ],
)
def test_codes_are_decoded_by_hand(decoder, code, feature):
    torch.testing.assert_close(decode(torch.tensor([code]), decoder), torch.tensor([feature]))


@pytest.mark.parametrize("after", [("relu", "relu", "none"), ("none", "softmax", "none")])
def test_channels_that_are_zero_are_left_out_without_a_difference(after):
    """Without gradients; the last rows are codes of 0, for which the first layer gives 0 alone."""
    widths, rng = (3, 80, 70, 5), np.random.default_rng(0)
    values = rng.normal(size=sum((wide + 1) * high for wide, high in pairwise(widths))).astype(np.float32)
    values[240:320] = 0.0
    decoder = Decoder(widths, values, after=after)
    codes = torch.from_numpy(np.r_[rng.normal(size=(4, 3)), np.zeros((2, 3))].astype(np.float32))
    codes[:4, 1:] = codes[:1, 1:]
    for part in (codes, codes[:4], codes[4:], codes[:0], codes[0]):
        with torch.inference_mode():
            found = decode(part, decoder)
        torch.testing.assert_close(found, decode(part, decoder))


def test_metadata_names_every_field():
    fields = {"after": ["relu", "softmax", "none"], "unit_input": True, "skips": [[0, 1]]}
    decoder = chain(EYE, EYE, EYE, after=("relu", "softmax", "none"), unit_input=True, skips=((0, 1),))
    assert decoder_metadata(decoder) == {"widths": [2, 2, 2, 2]} | fields

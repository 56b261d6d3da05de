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


def test_softmax_chooses_rows_of_a_code_book():
    """Certain logits give their row; equal ones of norms 1 and 3 lean to the longer row, which is not normalized."""
    book = chain(EYE, ([[1.0, 0.0], [0.0, 3.0]], [0.0, 0.0]), after=("softmax", "none"))
    codes = torch.tensor([[60.0, 0.0], [0.0, 60.0], [5.0, 5.0]])
    root = 10**-0.5
    expected = torch.tensor([[1.0, 0.0], [0.0, 1.0], [root, 3 * root]])
    torch.testing.assert_close(decode(codes, book), expected)


def test_without_names_relu_stands_between_layers_only():
    mixed = torch.tensor([[-3.0, 4.0]])
    named = chain(EYE, EYE, after=("relu", "none"))
    torch.testing.assert_close(decode(mixed, chain(EYE, EYE)), decode(mixed, named))
    torch.testing.assert_close(decode(mixed, named), torch.tensor([[0.0, 1.0]]))
    torch.testing.assert_close(
        decode(mixed, chain(EYE, EYE, after=("none", "none"))), torch.tensor([[-0.6, 0.8]])
    )


def test_a_skip_adds_what_the_early_layer_passed_on():
    """Layer 0 gives (1, 0), layer 1 turns it to (0, 1), and the sum is (1, 1)."""
    turn = ([[0.0, -1.0], [1.0, 0.0]], [0.0, 0.0])
    after = ("relu", "relu", "none")
    codes, root = torch.tensor([[1.0, 0.0]]), 0.5**0.5
    torch.testing.assert_close(decode(codes, chain(EYE, turn, EYE, after=after)), torch.tensor([[0.0, 1.0]]))
    skipping = chain(EYE, turn, EYE, after=after, skips=((0, 1),))
    torch.testing.assert_close(decode(codes, skipping), torch.tensor([[root, root]]))


@pytest.mark.parametrize("after", [("relu", "relu", "none"), ("none", "softmax", "none")])
def test_channels_that_are_zero_are_left_out_without_a_difference(after):
    """Without gradients; the last rows are codes of 0, for which the first layer gives 0 alone."""
    widths, rng = (3, 80, 70, 5), np.random.default_rng(0)
    values = rng.normal(size=sum((wide + 1) * high for wide, high in pairwise(widths))).astype(np.float32)
    values[240:320] = 0.0
    decoder = Decoder(widths, values, after=after)
    codes = torch.from_numpy(np.r_[rng.normal(size=(4, 3)), np.zeros((2, 3))].astype(np.float32))
    codes[:4, 1:] = codes[:1, 1:]
    for part in (codes, codes[:4], codes[4:], codes[:0]):
        with torch.inference_mode():
            found = decode(part, decoder)
        torch.testing.assert_close(found, decode(part, decoder))


def test_a_unit_input_forgets_the_norm_and_keeps_zero():
    shifted = ([[1.0, 0.0], [0.0, 1.0]], [1.0, 0.0])
    decoder = chain(shifted, unit_input=True)
    torch.testing.assert_close(*decode(torch.tensor([[0.0, 1.0], [0.0, 1e-3]]), decoder))
    torch.testing.assert_close(decode(torch.zeros(1, 2), decoder), torch.tensor([[1.0, 0.0]]))


@pytest.mark.parametrize(
    "fields",
    [
        {"after": ("relu",)},
        {"after": ("relu", "relu", "relu")},
        {"after": ("tanh", "relu", "none")},
        {"skips": ((0, 2),)},
        {"skips": ((1, 0),)},
        {"skips": ((-1, 1),)},
    ],
)
def test_fields_that_do_not_agree_are_rejected(fields):
    with pytest.raises(ValueError):
        chain(EYE, EYE, EYE, **fields)


def test_metadata_names_every_field():
    decoder = chain(EYE, EYE, EYE, after=("relu", "softmax", "none"), unit_input=True, skips=((0, 1),))
    assert decoder_metadata(decoder) == {
        "widths": [2, 2, 2, 2],
        "after": ["relu", "softmax", "none"],
        "unit_input": True,
        "skips": [[0, 1]],
    }

"""How well features fit queries; folded decoders give the same cosines."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch

from egosplat.language.decoder import Decoder, decode, project
from egosplat.query import relevancy as module
from egosplat.query.relevancy import relevancy_maps
from egosplat.query.text import Texts


def unit(*shape: int, seed: int = 0) -> torch.Tensor:
    drawn = torch.randn(*shape, generator=torch.Generator().manual_seed(seed))
    return torch.nn.functional.normalize(drawn, dim=-1)


def test_maps_compare_decoded_codes_with_phrases(monkeypatch):
    wide = Texts(("a", "b", "c"), *(unit(size, 16, seed=size) for size in (3, 4)))
    whole = decoder(3, 5, 16)
    codes = torch.randn(2, 7, 5, 3, generator=torch.Generator().manual_seed(5))
    seen = torch.rand(2, 7, 5, generator=torch.Generator().manual_seed(6)) > 0.3
    fits, usual = (decode(codes, whole) @ rows.T for rows in (wide.queries, wide.canonical))
    expected = torch.sigmoid(10 * (fits - usual.amax(-1, keepdim=True))).movedim(-1, 0)
    for at_once in (2**18, 64):
        monkeypatch.setattr(module, "_NUMBERS_AT_ONCE", at_once)
        found = relevancy_maps(codes, seen, whole, wide, 10.0)
        assert found.shape == (3, 2, 7, 5) and found.dtype == torch.float32
        torch.testing.assert_close(found, torch.where(seen, expected, 0.0), rtol=0, atol=1e-5)


def decoder(*widths: int, scale: float = 1.0) -> Decoder:
    rng = np.random.default_rng(0)
    count = sum(wide * (narrow + 1) for narrow, wide in pairwise(widths))
    return Decoder(widths, (scale * rng.normal(size=count)).astype(np.float32))


@pytest.mark.parametrize("widths, folded", [((3, 40), (3, 4)), ((3, 8, 16, 64), (3, 8, 16, 17))])
@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_folding_changes_no_cosine(widths, folded, scale):
    codes, directions = unit(50, widths[0], seed=1), unit(6, widths[-1], seed=2)
    whole = decoder(*widths, scale=scale)
    small, basis = whole.folded
    projected = project(directions, basis)
    assert small.widths == folded and projected.shape == (6, folded[-1]) and projected.dtype == torch.float32
    expected = decode(codes, whole) @ directions.T
    torch.testing.assert_close(decode(codes, small) @ projected.T, expected, rtol=0, atol=2e-6)
    assert (expected.abs() > 0.05).any()


def test_folding_keeps_what_stands_before_the_last_layer():
    """A softmax over code words, a skip, and codes of any norm."""
    before = ("relu", "relu", "softmax", "none")
    whole = replace(decoder(3, 8, 8, 16, 64), after=before, unit_input=True, skips=((0, 1),))
    codes, directions = torch.randn(50, 3), torch.randn(6, 64)
    small, basis = whole.folded
    projected = project(directions, basis)
    assert small.widths == (3, 8, 8, 16, 17) and (small.after, small.skips) == (before, ((0, 1),))
    expected = decode(codes, whole) @ directions.T
    torch.testing.assert_close(decode(codes, small) @ projected.T, expected, rtol=0, atol=2e-5)
    torch.testing.assert_close(decode(3 * codes, small), decode(codes, small))


@pytest.mark.parametrize("widths", [(4,), (4, 5), (4, 3), (3, 8, 9)])
def test_folding_is_skipped_if_it_saves_nothing(widths):
    whole = decoder(*widths)
    assert whole.folded == (whole, None)

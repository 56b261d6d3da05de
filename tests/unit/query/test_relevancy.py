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
    assert relevancy_maps(codes[:, :0], seen[:, :0], whole, wide, 10.0).shape == (3, 2, 0, 5)


def decoder(*widths: int, scale: float = 1.0) -> Decoder:
    rng = np.random.default_rng(0)
    count = sum(wide * (narrow + 1) for narrow, wide in pairwise(widths))
    return Decoder(widths, (scale * rng.normal(size=count)).astype(np.float32))


# A softmax over code words, a skip, and codes of any norm.
ODD = {"after": ("relu", "relu", "softmax", "none"), "unit_input": True, "skips": ((0, 1),)}
WIDTHS = [((3, 40), {}, 4), ((3, 8, 16, 64), {}, 17), ((3, 8, 8, 16, 64), ODD, 17)]


@pytest.mark.parametrize("widths, how, last", WIDTHS)
@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_folding_changes_no_cosine(widths, how, last, scale):
    codes, directions = unit(50, widths[0], seed=1), unit(6, widths[-1], seed=2)
    whole = replace(decoder(*widths, scale=scale), **how)
    small, basis = whole.folded
    projected = project(directions, basis)
    assert small.widths == (*widths[:-1], last) and replace(small, **how) == small
    assert projected.shape == (6, last) and projected.dtype == torch.float32
    expected = decode(codes, whole) @ directions.T
    torch.testing.assert_close(decode(codes, small) @ projected.T, expected, rtol=0, atol=2e-6)
    assert not how or torch.equal(decode(2 * codes, small), decode(codes, small))
    assert (expected.abs() > 0.05).any()


@pytest.mark.parametrize("widths", [(4,), (4, 5), (4, 3), (3, 8, 9)])
def test_folding_is_skipped_if_it_saves_nothing(widths):
    whole = decoder(*widths)
    assert whole.folded == (whole, None)

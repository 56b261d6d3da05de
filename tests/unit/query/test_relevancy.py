"""How well features fit queries."""

import numpy as np
import pytest
import torch

from egosplat.language.decoder import Decoder, decode
from egosplat.query import relevancy as module
from egosplat.query.relevancy import relevancy, relevancy_maps
from egosplat.query.text import Texts

IDENTITY = Decoder((6,), np.zeros(0, np.float32))


def unit(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.nn.functional.normalize(
        torch.randn(*shape, generator=torch.Generator().manual_seed(seed)), dim=-1
    )


@pytest.fixture
def texts() -> Texts:
    return Texts(("a", "b", "c"), unit(3, 6, seed=1), unit(4, 6, seed=2))


@pytest.mark.parametrize("temperature, expected", [(10.0, 0.62246), (1.0, 0.51250)])
def test_relevancy_has_its_known_values(temperature, expected):
    feature = torch.tensor([1.0, 0.0])
    query = torch.tensor([[0.30, 0.0]])
    canonical = torch.tensor([[0.25, 0.0], [0.20, 0.0], [0.22, 0.0], [0.18, 0.0]])
    assert relevancy(feature, query, canonical, temperature).item() == pytest.approx(expected, abs=5e-6)


def test_maps_are_the_relevancy_of_decoded_codes(texts, monkeypatch):
    rng = np.random.default_rng(0)
    decoder = Decoder((3, 5, 16), rng.normal(size=4 * 5 + 6 * 16).astype(np.float32))
    wide = Texts(texts.phrases, unit(3, 16, seed=3), unit(4, 16, seed=4))
    codes = torch.randn(2, 7, 5, 3, generator=torch.Generator().manual_seed(5))
    seen = torch.rand(2, 7, 5, generator=torch.Generator().manual_seed(6)) > 0.3
    expected = relevancy(decode(codes, decoder), wide.queries, wide.canonical, 10.0).permute(3, 0, 1, 2)
    for at_once in (2**18, 64):
        monkeypatch.setattr(module, "_NUMBERS_AT_ONCE", at_once)
        found = relevancy_maps(codes, seen, decoder, wide, 10.0)
        assert found.shape == (3, 2, 7, 5) and found.dtype == torch.float32
        torch.testing.assert_close(found, torch.where(seen, expected, 0.0), rtol=0, atol=1e-5)


def test_a_code_that_vanishes_has_no_relevancy(texts):
    codes, seen = unit(1, 2, 2, 6), torch.ones(1, 2, 2, dtype=torch.bool)
    codes[0, 0, 0] = 0.0
    found = relevancy_maps(codes, seen, IDENTITY, texts, 10.0)
    assert not found[:, 0, 0, 0].any() and (found[:, 0, 1] > 0).all()


def test_invalid_arguments_are_rejected(texts):
    codes, seen = unit(1, 2, 2, 6), torch.ones(1, 2, 2, dtype=torch.bool)
    with pytest.raises(ValueError, match="do not match"):
        relevancy_maps(codes, seen[0], IDENTITY, texts, 10.0)

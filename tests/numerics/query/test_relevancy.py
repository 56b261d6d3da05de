"""Relevancy at the ends of its temperature, and of features that are none."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from egosplat.language.decoder import Decoder
from egosplat.query import relevancy as module
from egosplat.query.options import QueryOptions
from egosplat.query.relevancy import relevancy_maps
from egosplat.query.text import Texts
from tests.support.langsplat import LANGSPLAT

WIDTH = 512
ENDS = [1e-3, 1.0, 10.0, 1e3, 1e4]
IDENTITY = Decoder((4,), np.zeros(0, np.float32))
SEEN = torch.ones(1, 2, 2, 4), torch.ones(1, 2, 2, dtype=torch.bool)


def directions(seed: int, count: int) -> torch.Tensor:
    """(count, 512) float32 of unit norm."""
    rows = np.random.default_rng(seed).normal(size=(count, WIDTH))
    return torch.from_numpy(rows / np.linalg.norm(rows, axis=1, keepdims=True)).float()


def relevancy(features, queries, canonical, temperature: float) -> torch.Tensor:
    return module.relevancy(features, Texts(("",) * len(queries), queries, canonical), temperature)


def papers(features, queries, canonical, temperature: float) -> torch.Tensor:
    """The paper's minimum over softmaxes of pairs, in float64."""
    fits, common = (features.double() @ rows.double().T for rows in (queries, canonical))
    pairs = torch.stack(torch.broadcast_tensors(fits[:, :, None], common[:, None, :]))
    return torch.softmax(temperature * pairs, dim=0)[0].amin(dim=-1)


@pytest.mark.numerics("temperature of 1e-3 to 1e2, 512 channels", within=1e-5)
@given(exponent=st.floats(-3, 2), seed=st.integers(0, 999))
def test_usual_temperatures(measured, exponent, seed):
    given_ = directions(seed, 60), directions(seed + 1, 5), directions(seed + 2, 4), 10.0**exponent
    measured(float((relevancy(*given_) - papers(*given_)).abs().max()))


@pytest.mark.numerics("temperature of 1e2 to 1e4", within=1e-3, outside="up to 1e38: 0 or 1")
@given(exponent=st.floats(2, 4), seed=st.integers(0, 999))
def test_high_temperatures(measured, exponent, seed):
    given_ = directions(seed, 60), directions(seed + 1, 5), directions(seed + 2, 4), 10.0**exponent
    measured(float((relevancy(*given_) - papers(*given_)).abs().max()))
    hottest = relevancy(*given_[:3], 1e38)
    assert ((hottest >= 0) & (hottest <= 1)).all()


@pytest.mark.numerics("query equal to the best canonical phrase", within=1e-3, outside="relevancy 0.5")
@pytest.mark.parametrize("temperature", ENDS)
def test_a_query_that_is_canonical(measured, temperature):
    canonical = directions(0, 4)
    best = relevancy(canonical, canonical, canonical, temperature)
    measured(float((best.diagonal() - 0.5).abs().max()))
    alone = relevancy(directions(1, 50), canonical[:1], canonical[:1], temperature)
    measured(float((alone - 0.5).abs().max()))


@pytest.mark.numerics(
    "float16 and bfloat16 features, queries and phrases", within=1e-3, outside="computed in float32"
)
@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
@pytest.mark.parametrize("temperature", ENDS)
def test_half_precision(measured, dtype, temperature):
    rows = [directions(seed, count).to(dtype) for seed, count in ((5, 60), (6, 5), (7, 4))]
    found = relevancy(*rows, temperature)
    assert found.dtype == torch.float32
    measured(float((found - papers(*rows, temperature)).abs().max()))


@pytest.mark.numerics("feature 0, NaN, infinity; length below 0.7 or above 1.3", outside="relevancy 0")
@pytest.mark.parametrize("temperature", ENDS)
@pytest.mark.parametrize("value", [0.0, float("nan"), float("inf"), -float("inf"), 1e-3, 1e30])
def test_invalid_features_have_no_relevancy(value, temperature):
    features = directions(8, 3)
    queries = features[[0, 2]]
    features[1] = value
    found = relevancy(features, queries, directions(10, 4), temperature)
    assert not found[1].any() and (found[[0, 2]].diagonal() >= 0.5).all()
    assert ((found >= 0) & (found <= 1)).all()


@pytest.mark.numerics("no query; no canonical phrase", outside="empty result; ValueError")
def test_no_queries_give_an_empty_result():
    found = relevancy_maps(*SEEN, IDENTITY, Texts((), torch.zeros(0, 4), torch.eye(4)), 10.0)
    assert found.shape == (0, 1, 2, 2)
    with pytest.raises(ValueError, match="canonical"):
        QueryOptions(**vars(LANGSPLAT) | {"canonical": ()})


@pytest.mark.numerics(
    "cosines from codes of length 1e-3 to 1e3, without decoding",
    within=1e-5,
    outside="code not finite: ValueError",
)
@given(exponent=st.floats(-3, 3), seed=st.integers(0, 999))
def test_folded_decoders(measured, exponent, seed):
    rng = np.random.default_rng(seed)
    decoder = Decoder((8, WIDTH), rng.normal(size=9 * WIDTH).astype(np.float32))
    codes = torch.from_numpy(rng.normal(size=(1, 4, 4, 8)) * 10.0**exponent).float()
    texts = Texts(("a", "b"), directions(seed, 2), directions(seed + 1, 4))
    found = relevancy_maps(codes, torch.ones(1, 4, 4, dtype=torch.bool), decoder, texts, 10.0)
    weights, biases = decoder.layers(codes.double())[0]
    features = torch.nn.functional.normalize(codes.double().reshape(16, 8) @ weights.T + biases, dim=-1)
    truth = papers(features, texts.queries, texts.canonical, 10.0).T.reshape(found.shape)
    measured(float((found - truth).abs().max()))
    assert decoder.folded[0].widths == (8, 9)


@pytest.mark.numerics("rendered codes with one NaN or infinity", outside="ValueError")
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_codes_that_are_not_finite(value):
    codes, texts = SEEN[0].clone(), Texts(("a",), torch.eye(4)[:1], torch.eye(4)[1:])
    codes[0, 1, 1, 2] = value
    with pytest.raises(ValueError, match="not finite"):
        relevancy_maps(codes, SEEN[1], IDENTITY, texts, 10.0)

"""Masks at the extremes: probabilities, thresholds, and images masked completely."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from egosplat.gaussians.loss import l1_ssim, l2
from egosplat.gaussians.training_views import pixel_weight
from egosplat.moving_regions import InstanceScores
from egosplat.transient.masks_stage import refined_mask, transient_instances

SIZE = 12


def scored(*frames: tuple[np.ndarray, np.ndarray]) -> InstanceScores:
    scores = InstanceScores(2)
    for labels, probability in frames:
        scores.add(labels, probability)
    return scores


def halves() -> np.ndarray:
    """(1, 12, 12) labels: instance 0 above, 1 below."""
    labels = np.zeros((1, SIZE, SIZE), np.int32)
    labels[:, SIZE // 2 :] = 1
    return labels


@pytest.mark.numerics("scores of 1 to 30 float16 frames, against extended precision", within=1e-14)
@given(seed=st.integers(0, 999), frames=st.integers(1, 30))
def test_scores(measured, seed, frames):
    rng = np.random.default_rng(seed)
    labels = rng.integers(-1, 2, (frames, 1, SIZE, SIZE)).astype(np.int32)
    probability = rng.uniform(size=(frames, SIZE, SIZE)).astype(np.float16)
    found = scored(*zip(labels, probability, strict=True))
    for instance in range(2):
        own = probability.astype(np.longdouble)[labels[:, 0] == instance]
        measured(abs(float(found.scores[instance] - own.mean())))


@pytest.mark.numerics("scores of probabilities 0 and 1", within=0.0)
@pytest.mark.parametrize("value", [0.0, 1.0])
def test_exact_probabilities(measured, value):
    found = scored(*[(halves(), np.full((SIZE, SIZE), value, np.float16))] * 1000)
    measured(np.abs(found.scores - value).max())


@pytest.mark.numerics("T = 0; T = 1", outside="instances with a pixel; those whose pixels are all 1")
def test_thresholds_at_their_ends():
    probability = np.ones((SIZE, SIZE), np.float16)
    probability[0, 0] = 1 - 2**-11
    found = scored((halves(), probability))
    chosen = [transient_instances(found.scores, found.pixels, t).tolist() for t in (0.0, 1.0)]
    assert chosen == [[True, True], [False, True]]
    nothing = InstanceScores(2)
    assert not transient_instances(nothing.scores, nothing.pixels, 0.0).any()


@pytest.mark.numerics(
    "weights 1 - M for M = 0 and 1, inside and outside the lens circle",
    within=0.0,
    outside="M beyond 0..1: clamped; NaN, infinity: weight 0",
)
@pytest.mark.parametrize(
    ("transient", "expected"),
    [(0.0, 1.0), (1.0, 0.0), (-3.0, 1.0), (7.0, 0.0), (np.nan, 0.0), (np.inf, 0.0), (-np.inf, 0.0)],
)
def test_weights(measured, transient, expected):
    valid, probability = torch.ones(3, 2), torch.full((3, 2), transient, dtype=torch.float16)
    valid[0, 0], probability[2] = 0.0, 0.5
    weight = pixel_weight(valid, probability)
    assert weight[0, 0] == 0.0 and (weight[2] == 0.5).all()
    measured(float((weight[1] - expected).abs().max()))


@pytest.mark.numerics("no instance, no labels, only labels of -1", outside="empty mask")
def test_no_instances():
    assert not refined_mask(np.full((3, 4, 5), -1, np.int32), np.zeros(0, bool)).any()
    assert not refined_mask(np.full((3, 4, 5), -1, np.int32), np.ones(2, bool)).any()


@pytest.mark.numerics(
    "loss of a picture with all pixels masked, or none valid", within=1e-8, outside="0, gradient exactly 0"
)
@pytest.mark.parametrize("loss", ["l1_ssim", "l2"])
def test_all_pixels_masked(measured, loss):
    render = torch.rand(SIZE, SIZE, 3, requires_grad=True)
    given_ = render, torch.rand(SIZE, SIZE, 3), torch.zeros(SIZE, SIZE)
    value = l1_ssim(*given_, 0.2) if loss == "l1_ssim" else l2(*given_)
    value.backward()
    measured(abs(value.item()))
    assert not render.grad.any()

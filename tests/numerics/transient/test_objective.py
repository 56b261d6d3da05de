"""The network's loss at extreme penalties, images and residuals."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from egosplat.transient.network import make_network
from egosplat.transient.objective import LEAST_SCALE, InitialObjective, ResidualScale
from tests.unit.transient.conftest import make_objective, take_steps

SIZE, PENALTY = 32, 0.004


def sound(one: InitialObjective) -> bool:
    """Whether all weights, and the probabilities of a picture, are finite and within bounds."""
    tensors = [tensor for tensor in one.net.state_dict().values() if tensor.is_floating_point()]
    with torch.no_grad():
        probability = one.net(torch.rand(SIZE, SIZE, 3), SIZE, SIZE)
    return all(bool(tensor.isfinite().all()) for tensor in tensors) and bool(
        ((probability >= 0) & (probability <= 1)).all()
    )


@pytest.mark.numerics("loss with the network's probabilities, residuals of 1e-4 to 1e3", within=1e-6)
@pytest.mark.parametrize("offset", [1e-4, 0.1, 1.0, 1e3])
def test_the_loss(views, measured, offset):
    one = make_objective(transient_penalty=PENALTY)
    picture = views.picture(0)
    image = picture + offset
    with torch.no_grad():
        probability = one.net(picture, SIZE, SIZE).double()
        found = one.loss(image, views, 0).item()
    error = (image.double() - picture).square().sum(dim=2)
    truth = float(((1 - probability) * error).mean() + PENALTY * probability.mean())
    measured(abs(found - truth) / truth)


@pytest.mark.parametrize(
    ("penalty", "rate"),
    [
        pytest.param(penalty, rate, marks=pytest.mark.numerics(tried, outside=outside))
        for penalty, rate, tried, outside in (
            (0.0, 1e-2, "transient_penalty = 0", "probability rises"),
            (1e6, 1e-2, "transient_penalty = 1e6", "probability falls"),
            (PENALTY, 0.1, "transient.lr times 100", "probabilities in 0..1, finite weights"),
        )
    ],
)
def test_extreme_training(views, penalty, rate):
    one = make_objective(transient_penalty=penalty, lr=rate, iterations=20)
    losses = take_steps(one, views, 20)
    assert sound(one) and (rate == 0.1 or losses[-1] < losses[0])


@pytest.mark.numerics("transient_penalty = 1e30: gradient norm overflows float32", outside="step skipped")
def test_transient_penalty_beyond_float32(views):
    one = make_objective(transient_penalty=1e30)
    before = [p.detach().clone() for p in one.net.parameters()]
    take_steps(one, views, 3)
    assert sound(one)
    assert all(torch.equal(*pair) for pair in zip(before, one.net.parameters(), strict=True))


SOME = pytest.mark.numerics(
    "unit of λ2: residuals 0, NaN, infinity, 1e30; one view; none",
    outside="finite, at least the rounding to 8 bits",
)
UNLIKE = pytest.mark.numerics(
    "unit of λ2: one black view, one blurred, all blurred", outside="they do not stand out"
)


@pytest.mark.parametrize(
    ("residuals", "unit"),
    [
        *(
            pytest.param([value], unit, marks=SOME)
            for value, unit in (
                (0.0, LEAST_SCALE),
                (np.nan, LEAST_SCALE),
                (np.inf, LEAST_SCALE),
                (1e30, 1e30),
            )
        ),
        *(
            pytest.param([own, others, others], unit, marks=UNLIKE)
            for own, others, unit in ((0.0, 1e-3, 1e-3), (0.1, 1e-3, 0.1), (0.1, 0.1, 0.1))
        ),
    ],
)
def test_residual_unit_at_its_ends(residuals, unit):
    one, blind = ResidualScale(torch.device("cpu")), ResidualScale(torch.device("cpu"))
    for view, value in enumerate(residuals):
        one.measure(view, 3, torch.full((8, 8), value), None)
    assert one.unit(0).item() == pytest.approx(unit) and not one.stands_out(0).any()
    blind.measure(0, 3, torch.ones(8, 8), torch.zeros(8, 8))
    assert blind.unit(0).item() == pytest.approx(LEAST_SCALE) and not blind.stands_out(0).any()


@pytest.mark.numerics("renders with NaN, infinity, 1e30", outside="weight 0; finite network")
@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e30])
def test_broken_renders(views, value):
    one = make_objective()
    image = views.picture(0) + 0.1
    image[3:9] = value
    image.requires_grad_()
    loss = one.loss(image, views, 0)
    loss.backward()
    one.step()
    assert loss.isfinite() and image.grad.isfinite().all() and not image.grad[3:9].any() and sound(one)


@pytest.mark.numerics(
    "pictures without a valid pixel", within=1e-7, outside="no gradient; probability falls to 0"
)
def test_no_valid_pixel(views, measured):
    blind = replace(views, valid=torch.zeros(SIZE, SIZE))
    one = make_objective(transient_penalty=PENALTY)
    image = (blind.picture(0) + 0.3).requires_grad_()
    with torch.no_grad():
        mean = one.net(blind.picture(0), SIZE, SIZE).double().mean()
    loss = one.loss(image, blind, 0)
    loss.backward()
    measured(abs(loss.item() - PENALTY * float(mean)))
    assert not image.grad.any()


@pytest.mark.numerics("pictures of one color: black, grey, white", outside="probabilities in 0..1")
@pytest.mark.parametrize("color", [0.0, 0.5, 1.0])
def test_one_color(color):
    net = make_network(64, False, None, 0)
    for mode in (True, False):
        with torch.no_grad():
            probability = net.train(mode)(torch.full((SIZE, SIZE, 3), color), SIZE, SIZE)
        assert ((probability >= 0) & (probability <= 1)).all()


@pytest.mark.numerics(
    "logits of -200 to 200, in float32 and float16", within=3e-4, outside="exactly 0 and 1 at the ends"
)
def test_logits_at_their_ends(measured):
    net = make_network(64, False, None, 0).eval()
    with torch.no_grad():
        net.head.weight.zero_()
        for logit in (-200.0, -20.0, -3.0, 0.0, 3.0, 20.0, 200.0):
            net.head.bias.fill_(logit)
            found = net(torch.rand(SIZE, SIZE, 3), 8, 8).numpy().astype(np.float16).astype(np.float64)
            measured(np.abs(found - 1 / (1 + np.exp(-np.float64(logit)))).max())
            assert ((found >= 0) & (found <= 1)).all()

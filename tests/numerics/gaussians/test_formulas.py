"""Loss, Adam, relocation and initialization against float64, up to the limits of float32."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from egosplat.errors import UserError
from egosplat.gaussians.density_control import reset_opacities
from egosplat.gaussians.initialization import SH_C0, from_points, neighbor_distance
from egosplat.gaussians.loss import LARGEST_VALUE, l1_ssim, l2, torch_l1_ssim
from egosplat.gaussians.model import Gaussians, rotations
from egosplat.gaussians.optimizer import BETA1, BETA2, EPS, Adam, LearningRates, adam_step

SIZE = 20


def values_and_gradients(
    render: torch.Tensor, target: torch.Tensor, weight: torch.Tensor | None
) -> list[tuple]:
    """Loss and gradient as training has them, and by the definition in float64."""
    results = []
    for function, dtype in ((l1_ssim, torch.float32), (torch_l1_ssim, torch.float64)):
        leaf = render.detach().to(dtype).requires_grad_()
        loss = function(leaf, target.to(dtype), None if weight is None else weight.to(dtype), 0.2)
        loss.backward()
        results.append((loss.item(), leaf.grad.double()))
    return results


def errors(render: torch.Tensor, target: torch.Tensor, weight: torch.Tensor | None) -> tuple[float, float]:
    (found, gradient), (truth, expected) = values_and_gradients(render, target, weight)
    return abs(found - truth) / truth, float((gradient - expected).norm() / expected.norm())


@pytest.mark.numerics(
    "loss: noise 1 to 1e8 times as bright as the photograph",
    within=1e-6,
    outside="above 1e8, not finite: weight 0",
)
@given(exponent=st.floats(0, 8), seed=st.integers(0, 99))
def test_loss_of_noise(measured, exponent, seed):
    generator = torch.Generator().manual_seed(seed)
    render, target = torch.rand(2, SIZE, SIZE, 3, generator=generator)
    for error in errors(render * 10.0**exponent, target, None):
        measured(error)


@pytest.mark.numerics("loss: one color (0 to 1e3) against another", within=1e-3, outside="variances cancel")
@pytest.mark.parametrize("level", [0.0, 1e-3, 0.3, 1.0, 10.0, 1e3])
def test_loss_of_one_color(measured, level):
    for error in errors(torch.full((SIZE, SIZE, 3), level), torch.full((SIZE, SIZE, 3), 0.5), None):
        measured(error)


@pytest.mark.numerics("loss: render equal to the photograph", within=1e-6, outside="absolute error")
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_loss_of_equal_pictures(measured, noise):
    target = 0.5 + noise * (torch.rand(SIZE, SIZE, 3, generator=torch.Generator().manual_seed(0)) - 0.5)
    (found, gradient), _ = values_and_gradients(target, target, None)
    measured(abs(found))
    measured(float(gradient.norm()))


@pytest.mark.numerics(
    "loss: NaN, infinity, 1e9 in render, photograph or weight", within=1e-6, outside="as with weight 0"
)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 10 * LARGEST_VALUE])
@pytest.mark.parametrize("which", ["render", "target", "weight"])
def test_loss_of_broken_numbers(measured, value, which):
    generator = torch.Generator().manual_seed(0)
    given_ = {name: torch.rand(SIZE, SIZE, 3, generator=generator) for name in ("render", "target")}
    given_["weight"] = torch.rand(SIZE, SIZE, generator=generator)
    clean = {name: tensor.clone() for name, tensor in given_.items()}
    clean["weight"][7, 9] = 0.0
    given_[which][7, 9] = value
    (found, gradient), _ = values_and_gradients(**given_)
    (truth, expected), _ = values_and_gradients(**clean)
    if which == "target":
        # A broken photograph is as a black one there, also to its neighbors' SSIM.
        clean["target"][7, 9] = 0.0
        (truth, expected), _ = values_and_gradients(**clean)
    assert gradient.isfinite().all() and not gradient[7, 9].any()
    measured(abs(found - truth))
    measured(float((gradient - expected).norm()))
    assert l2(**given_).isfinite() and torch_l1_ssim(**given_, ssim_lambda=0.2).isfinite()


@pytest.mark.numerics(
    "Adam: 20 steps, gradients of 1e-18 to 1e17", within=1e-5, outside="squares below 1e-23 vanish in float32"
)
@given(exponent=st.floats(-18, 17), seed=st.integers(0, 99))
def test_adam(measured, exponent, seed):
    generator = torch.Generator().manual_seed(seed)
    grads = torch.randn(20, 6, 3, generator=generator) * 10.0**exponent
    param, first, second = torch.zeros(6, 3), torch.zeros(6, 3), torch.zeros(6, 3)
    exact = [torch.zeros(6, 3, dtype=torch.float64) for _ in range(3)]
    for step, grad in enumerate(grads, 1):
        adam_step([(param, grad, first, second, 0.01)], torch.ones(6, dtype=torch.bool), step)
        wide = grad.double()
        exact[1] = BETA1 * exact[1] + (1 - BETA1) * wide
        exact[2] = BETA2 * exact[2] + (1 - BETA2) * wide**2
        denominator = (exact[2] / (1 - BETA2**step)).sqrt() + EPS
        exact[0] = exact[0] - 0.01 * exact[1] / (1 - BETA1**step) / denominator
    measured(float((param - exact[0]).norm() / exact[0].norm()))


@pytest.mark.numerics(
    "opacity reset where float32 rounds to 0 and 1", within=1e-6, outside="at most 0.05; finite logits"
)
def test_resets(measured):
    gaussians = Gaussians(
        means=torch.rand(4, 3, generator=torch.Generator().manual_seed(0)),
        quats=torch.tensor([[1.0, 0, 0, 0]]).repeat(4, 1),
        log_scales=torch.full((4, 3), -2.0),
        logit_opacities=torch.tensor([-200.0, -3.0, 3.0, 200.0]),
        sh=torch.zeros(4, 1, 3),
        features=torch.zeros(4, 0),
    ).requires_grad_()
    reset_opacities(gaussians, Adam(gaussians, LearningRates(means=0.1)), 0.05)
    assert gaussians.logit_opacities.isfinite().all()
    expected = [0.0, 1 / (1 + math.exp(3)), 0.05, 0.05]
    measured(
        float(
            (gaussians.opacities.detach().double() - torch.tensor(expected, dtype=torch.float64)).abs().max()
        )
    )


@pytest.mark.numerics(
    "first sizes: 2 to 60 points 1e-3 to 1e6 m apart",
    within=1e-6,
    outside="at least 0.3 mm; one point: 0.1 m",
)
@given(seed=st.integers(0, 999), count=st.integers(2, 60), exponent=st.floats(-3, 6))
def test_starting_sizes(measured, seed, count, exponent):
    points = np.random.default_rng(seed).normal(size=(count, 3)) * 10.0**exponent
    start = from_points(points, np.zeros((count, 3), np.uint8), sh_degree=0, max_points=99, seed=0)
    distance = np.sort(np.linalg.norm(points[:, None] - points[None], axis=2), axis=1)[:, 1:4].astype(
        np.longdouble
    )
    truth = np.sqrt(np.maximum((distance**2).mean(axis=1), 1e-7)).astype(float)
    measured(np.abs(neighbor_distance(points) / truth - 1).max())
    measured(float((start.scales[:, 0].double() / torch.from_numpy(truth) - 1).abs().max()) / 10)
    assert neighbor_distance(points[:1]) == [0.1] and neighbor_distance(points[:0]).shape == (0,)


@pytest.mark.numerics(
    "split Gaussians: quaternion length of 1e-10 to 1e15", within=1e-6, outside="0: identity"
)
@given(exponent=st.floats(-10, 15), seed=st.integers(0, 99))
def test_rotation_matrices_match_float64_at_any_length(measured, exponent, seed):
    quats = torch.randn(4, 4, generator=torch.Generator().manual_seed(seed)) * 10.0**exponent
    expected = Rotation.from_quat(quats.double().numpy(), scalar_first=True).as_matrix()
    measured(np.abs(rotations(quats).numpy() - expected).max())
    assert torch.equal(rotations(torch.zeros(1, 4))[0], torch.eye(3))


@pytest.mark.numerics("first points with NaN, infinity, 3.5e38 m", outside="dropped; none left: UserError")
@pytest.mark.parametrize("value", [math.nan, math.inf, -3.5e38])
def test_starting_points_beyond_float32(value):
    keys = {"sh_degree": 0, "max_points": 9, "seed": 0}
    points = np.array([[0.0, 0.0, 1.0], [0.0, value, 2.0], [0.0, 0.0, 3.0]])
    rgb = np.array([[0] * 3, [50] * 3, [100] * 3], np.uint8)
    start = from_points(points, rgb, **keys)
    assert start.means[:, 2].tolist() == [1.0, 3.0]
    np.testing.assert_allclose(start.sh[:, 0, 0].numpy() * SH_C0 + 0.5, [0, 100 / 255], atol=1e-6)
    with pytest.raises(UserError, match="no point to start from"):
        from_points(points[1:2], rgb[1:2], **keys)

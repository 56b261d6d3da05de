"""Adam over Gaussians equals torch's Adam and never stores a value that is not finite."""

import math

import pytest
import torch

from egosplat.gaussians.model import PARAMETERS, Gaussians
from egosplat.gaussians.optimizer import Adam, LearningRates
from egosplat.rasterize.kernels import library
from tests.unit.gaussians.test_model import make as random_gaussians

RATES = LearningRates(means=1e-3)


@pytest.fixture(params=["torch", "fused"], autouse=True)
def implementation(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Every test runs with plain torch and, where it is built, with the kernel."""
    if request.param == "fused" and library.why_not() is not None:
        pytest.skip(f"no kernels: {library.why_not()}")
    monkeypatch.setattr(library, "is_usable", lambda: request.param == "fused")
    return request.param


def make(n: int, channels: int = 2) -> Gaussians:
    return random_gaussians(n, 2, channels, seed=7).requires_grad_()


def set_gradients(gaussians: Gaussians, seed: int, scale: float = 1.0, hidden: object = slice(0)) -> None:
    generator = torch.Generator().manual_seed(seed)
    for parameter in gaussians.parameters().values():
        parameter.grad = torch.randn(parameter.shape, generator=generator) * scale
        parameter.grad[hidden] = 0.0


def torch_adam(gaussians: Gaussians) -> tuple[torch.optim.Adam, dict[str, torch.Tensor]]:
    """The stock optimizer, with SH in two tensors as 3DGS keeps them."""
    leaves = {name: p.detach().clone().requires_grad_() for name, p in gaussians.parameters().items()}
    sh = leaves.pop("sh").detach()
    leaves |= {"dc": sh[:, :1].clone().requires_grad_(), "rest": sh[:, 1:].clone().requires_grad_()}
    rates = {"means": 1e-3, "quats": 0.001, "log_scales": 0.005, "logit_opacities": 0.05, "features": 0.0025}
    rates |= {"dc": 0.0025, "rest": 0.000125}
    groups = [{"params": [leaves[name]], "lr": rate} for name, rate in rates.items()]
    return torch.optim.Adam(groups, betas=(0.9, 0.999), eps=1e-15), leaves


@pytest.mark.parametrize("scale", [1e-12, 1e-6, 1.0, 1e6])
def test_steps_equal_torchs_adam(scale: float) -> None:
    gaussians = make(11)
    reference, leaves = torch_adam(gaussians)
    optimizer = Adam(gaussians, RATES)
    for step in range(20):
        set_gradients(gaussians, step, scale)
        for name, leaf in leaves.items():
            parts = {"dc": gaussians.sh.grad[:, :1], "rest": gaussians.sh.grad[:, 1:]}
            leaf.grad = parts[name].clone() if name in parts else getattr(gaussians, name).grad.clone()
        if step == 10:
            optimizer.means_lr = reference.param_groups[0]["lr"] = 0.25
        reference.step()
        optimizer.step(None)
    for name, leaf in leaves.items():
        mine = {"dc": gaussians.sh[:, :1], "rest": gaussians.sh[:, 1:]}.get(
            name, getattr(gaussians, name, None)
        )
        torch.testing.assert_close(mine, leaf, rtol=1e-5, atol=1e-5 * 0.05)
    assert optimizer.step_count == 20


@pytest.mark.parametrize("share", [0.1, 0.9])
def test_invisible_rows_advance_only_the_step(share: float) -> None:
    one, other = make(40), make(40)
    known, unknown = Adam(one, RATES), Adam(other, RATES)
    for step in range(4):
        visible = torch.rand(40, generator=torch.Generator().manual_seed(step)) < share
        for gaussians in (one, other):
            set_gradients(gaussians, step, hidden=~visible)
        known.step(visible)
        unknown.step(None)
    for name in PARAMETERS:
        torch.testing.assert_close(getattr(one, name), getattr(other, name), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("value", [math.nan, -math.inf, 1e30])
@pytest.mark.parametrize("name", PARAMETERS)
@pytest.mark.parametrize("gathered", [False, True])
def test_a_broken_gradient_leaves_its_row_alone(value: float, name: str, gathered: bool) -> None:
    gaussians, visible = make(10), torch.arange(10) < (4 if gathered else 10)
    sound = make(10)
    optimizer, reference = Adam(gaussians, RATES), Adam(sound, RATES)
    for step, broken in enumerate([False, True, False]):
        for each in (gaussians, sound):
            set_gradients(each, step, hidden=~visible)
        if broken:
            getattr(gaussians, name).grad[2].flatten()[-1] = value
            if getattr(gaussians, name).ndim == 1:
                getattr(gaussians, name).grad[2] = value
            at_break = gaussians.detach().select(torch.arange(10)), optimizer.state_dict()
        optimizer.step(visible)
        reference.step(visible)
        if broken:
            state = optimizer.state_dict()
            for p in PARAMETERS:
                assert torch.equal(getattr(gaussians, p)[2], getattr(at_break[0], p)[2])
                assert torch.equal(state["moments"][p][:, 2], at_break[1]["moments"][p][:, 2])
    assert optimizer.skipped_rows == 1 and reference.skipped_rows == 0
    assert bool(gaussians.finite().all())
    others = torch.arange(10) != 2
    for p in PARAMETERS:
        assert torch.equal(getattr(gaussians, p)[others], getattr(sound, p)[others])


def test_replacing_rows_moves_their_moments() -> None:
    gaussians = make(5)
    optimizer = Adam(gaussians, RATES)
    set_gradients(gaussians, 0)
    optimizer.step(None)
    before = optimizer.state_dict()
    keep = torch.tensor([True, False, True, True, False])
    kept = gaussians.detach().select(keep)
    optimizer.replace_rows(Gaussians.concatenate([kept, make(2).detach()]).requires_grad_(), keep, 2)
    after = optimizer.state_dict()
    for name in PARAMETERS:
        assert torch.equal(after["moments"][name][:, :3], before["moments"][name][:, keep])
        assert not after["moments"][name][:, 3:].any()
    set_gradients(optimizer.gaussians, 1)
    optimizer.step(None)
    assert bool(optimizer.gaussians.finite().all())

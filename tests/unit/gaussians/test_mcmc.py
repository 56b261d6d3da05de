"""3DGS-MCMC relocates dead Gaussians, grows to the cap and adds bounded noise."""

import math

import pytest
import torch

from egosplat.gaussians.mcmc import (
    Mcmc,
    McmcOptions,
    add_noise,
    grow,
    most_copies,
    relocate,
)
from egosplat.gaussians.model import PARAMETERS, Gaussians, rotation_matrices
from egosplat.gaussians.schedule import STOCK_MCMC
from tests.support.gaussian_scene import with_moments

DEAD = 0.005


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def make(opacities: list[float]) -> Gaussians:
    n, generator = len(opacities), torch.Generator().manual_seed(1)
    return Gaussians(
        means=torch.randn(n, 3, generator=generator),
        quats=torch.randn(n, 4, generator=generator),
        log_scales=torch.randn(n, 3, generator=generator) - 4,
        logit_opacities=torch.tensor(opacities).logit(),
        sh=torch.randn(n, 4, 3, generator=generator),
        features=torch.randn(n, 2, generator=generator),
    ).requires_grad_()


def copy(gaussians: Gaussians) -> Gaussians:
    return Gaussians(**{name: p.detach().clone() for name, p in gaussians.parameters().items()})


def test_dead_gaussians_are_relocated_to_living_ones() -> None:
    gaussians = make([0.9, 0.001, 0.8, 0.005])
    before, optimizer = copy(gaussians), with_moments(gaussians)
    moments = optimizer.state_dict()["exp_avg"]
    relocate(gaussians, optimizer, DEAD, seeded())
    hosts = [
        min((0, 2), key=lambda host: float((gaussians.detach().means[row] - before.means[host]).norm()))
        for row in (1, 3)
    ]
    for row, host in zip((1, 3), hosts, strict=True):
        for name in PARAMETERS:
            assert torch.equal(getattr(gaussians, name)[row], getattr(gaussians, name)[host])
    for host in (0, 2):
        copies = 1 + hosts.count(host)
        transmittance = (1 - gaussians.opacities[host]) ** copies
        torch.testing.assert_close(transmittance, 1 - before.opacities[host], rtol=1e-4, atol=1e-6)
        assert torch.equal(gaussians.means[host], before.means[host])
        assert (copies == 1) == torch.equal(gaussians.log_scales[host], before.log_scales[host])
    after = optimizer.state_dict()["exp_avg"]
    for name in PARAMETERS:
        assert not any(after[name][host].any() for host in set(hosts))
        assert all(torch.equal(after[name][row], moments[name][row]) for row in (1, 3))


def test_without_dead_gaussians_nothing_is_relocated() -> None:
    gaussians = make([0.9, 0.2, 0.006])
    before = copy(gaussians)
    relocate(gaussians, with_moments(gaussians), DEAD, seeded())
    assert all(torch.equal(getattr(gaussians, name), getattr(before, name)) for name in PARAMETERS)


@pytest.mark.parametrize("name", PARAMETERS)
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_non_finite_gaussians_are_relocated_first(name: str, value: float) -> None:
    # The live one can take a single other: 1 - 0.99^(1/2) is above the limit, the cube root's is not.
    gaussians = make([0.001, 0.5, 0.0145])
    getattr(gaussians, name).detach()[1] = value
    optimizer = with_moments(gaussians)
    assert most_copies(torch.tensor([0.0145]), DEAD).tolist() == [2]
    relocate(gaussians, optimizer, DEAD, seeded())
    assert bool(gaussians.finite().all())
    assert torch.equal(gaussians.means[1], gaussians.means[2])
    assert not torch.equal(gaussians.means[0], gaussians.means[2])
    assert not optimizer.state_dict()["exp_avg"][name][1].any()


def test_few_living_gaussians_survive_many_relocations() -> None:
    gaussians = make([0.1] + [0.001] * 100)
    optimizer = with_moments(gaussians)
    relocate(gaussians, optimizer, DEAD, seeded())
    living = int((gaussians.opacities > DEAD).sum())
    assert living == int(most_copies(torch.tensor([0.1]), DEAD)[0]) == 19
    # Once more: nobody can share any further, and nobody dies.
    relocate(gaussians, optimizer, DEAD, seeded())
    assert int((gaussians.opacities > DEAD).sum()) == living


def test_growth_adds_copies_that_share() -> None:
    gaussians = make([0.9, 0.8, 0.001])
    before, optimizer = copy(gaussians), with_moments(gaussians)
    after = grow(gaussians, optimizer, 6, DEAD, seeded())
    assert after.count == 6 and after is optimizer.gaussians
    assert all(p.is_leaf and p.requires_grad for p in after.parameters().values())
    assert torch.equal(after.means[:3], before.means) and torch.equal(after.sh[2], before.sh[2])
    for host in (0, 1):
        same = (after.means == before.means[host]).all(dim=1)
        transmittance = (1 - after.opacities[same]).prod()
        torch.testing.assert_close(transmittance, 1 - before.opacities[host], rtol=1e-4, atol=1e-6)
    assert not optimizer.state_dict()["exp_avg"]["means"][3:].any()
    assert optimizer.state_dict()["exp_avg"]["means"][2].all()
    assert grow(after, optimizer, 6, DEAD, seeded()) is after
    assert grow(after, optimizer, 2, DEAD, seeded()) is after


def test_growth_stops_at_minimum_opacity() -> None:
    gaussians = make([0.006, 0.007])
    assert grow(gaussians, with_moments(gaussians), 10, DEAD, seeded()) is gaussians


def test_noise_follows_the_covariance_and_spares_opaque_gaussians() -> None:
    gaussians = make([DEAD]).detach().select(torch.zeros(4_000, dtype=torch.int64))
    gaussians.log_scales[:] = torch.tensor([0.3, 0.2, 0.1]).log()
    before = gaussians.means.clone()
    add_noise(gaussians, 10.0, DEAD, seeded())
    local = (gaussians.means - before) @ rotation_matrices(gaussians.quats[:1])[0]
    # Gate one half, times the factor, times the covariance.
    torch.testing.assert_close(local.std(dim=0), torch.tensor([0.45, 0.2, 0.05]), rtol=0.05, atol=0.0)
    torch.testing.assert_close(local.T.corrcoef(), torch.eye(3), rtol=0.0, atol=0.06)
    opaque = make([0.9] * 50)
    before = opaque.means.detach().clone()
    add_noise(opaque, 80.0, DEAD, seeded())
    torch.testing.assert_close(opaque.means.detach(), before)


def test_each_step_grows_to_the_cap_and_adds_noise() -> None:
    gaussians = make([0.05] * 41)
    optimizer = with_moments(gaussians)
    before = gaussians.means.detach().clone()
    strategy = Mcmc(McmcOptions(max_gaussians=44), STOCK_MCMC)
    strategy.observe(torch.zeros(1, 41, 2), torch.ones(1, 41, 2), 8, 8)
    assert strategy.step(599, gaussians, optimizer, seeded()) is gaussians
    assert not torch.equal(gaussians.means, before)
    counts = [
        strategy.step(iteration, optimizer.gaussians, optimizer, seeded()).count
        for iteration in (600, 601, 700, 25_000)
    ]
    assert counts == [44, 44, 44, 44]
    bigger = Mcmc(McmcOptions(max_gaussians=100), STOCK_MCMC)
    assert bigger.step(800, optimizer.gaussians, optimizer, seeded()).count == 47
    assert (strategy.opacity_reg, strategy.scale_reg) == (0.01, 0.01)


def test_noise_follows_the_learning_rate_of_the_means() -> None:
    gaussians = make([0.005] * 4)
    optimizer = with_moments(gaussians)
    optimizer.means_lr = 0.0
    before = gaussians.means.detach().clone()
    Mcmc(McmcOptions(max_gaussians=4), STOCK_MCMC).step(1, gaussians, optimizer, seeded())
    assert torch.equal(gaussians.means, before)

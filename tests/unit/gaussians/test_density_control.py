"""Density control of 3DGS clones, splits, prunes and resets at its thresholds, and keeps the optimizer in step."""

import math

import numpy as np
import pytest
import torch

from egosplat.errors import UserError
from egosplat.gaussians.density_control import (
    DensityControl,
    clone_or_split,
    reset_opacities,
    split_gaussians,
    too_large,
)
from egosplat.gaussians.model import PARAMETERS, Gaussians, rotations
from egosplat.gaussians.optimizer import Adam
from egosplat.gaussians.render import RenderSettings, render
from egosplat.gaussians.schedule import TrainingOptions
from egosplat.geometry import Camera
from tests.support.gaussian_scene import with_moments

EXTENT = 2.0
NOW, LATER = 600, 3_100
"""Iterations of density control in the stock schedule, before and after the first reset."""


def make(n: int, scale: float = 0.01, opacity: float = 0.5) -> Gaussians:
    generator = torch.Generator().manual_seed(1)
    return Gaussians(
        means=torch.randn(n, 3, generator=generator),
        quats=torch.randn(n, 4, generator=generator),
        log_scales=torch.full((n, 3), math.log(scale)),
        logit_opacities=torch.full((n,), opacity).logit(),
        sh=torch.randn(n, 4, 3, generator=generator),
        features=torch.randn(n, 2, generator=generator),
    ).requires_grad_()


def control(max_gaussians: int = 1000, **options: float) -> DensityControl:
    keys = {"grow_grad2d": 2e-4, "evaluate_every": 30_000, "seed": 0} | options
    settings = RenderSettings(0.1, "black", "reference")
    stock = TrainingOptions(render=settings, iterations=30_000, max_gaussians=max_gaussians, **keys)
    return DensityControl(stock, EXTENT)


def observe(density: DensityControl, grads: list[float], radius: int = 3) -> None:
    """One view of an image with half size 1, so that gradients count as they are."""
    means2d = torch.tensor([[[grad, 0.0] for grad in grads]])
    density.observe(means2d, torch.full(means2d.shape, radius, dtype=torch.int32), 2, 2)


def step(density: DensityControl, iteration: int, optimizer: Adam, seed: int = 0) -> Gaussians:
    return density.step(iteration, optimizer.gaussians, optimizer, torch.Generator().manual_seed(seed))


def test_small_ones_with_large_gradients_are_cloned() -> None:
    gaussians, density = make(4), control()
    optimizer = with_moments(gaussians)
    observe(density, [1e-4, 3e-4, 2e-4, 1.0])
    after = step(density, NOW, optimizer)
    assert after is optimizer.gaussians and after.means.is_leaf and after.means.requires_grad
    for name, tensor in gaussians.parameters().items():
        assert torch.equal(getattr(after, name), torch.cat([tensor, tensor[1:2], tensor[3:4]]))
    state = optimizer.state_dict()
    for name in PARAMETERS:
        assert state["moments"][name][:, :4].all() and not state["moments"][name][:, 4:].any()


def test_large_ones_with_large_gradients_are_split() -> None:
    gaussians, density = make(3, scale=0.05), control()
    optimizer = with_moments(gaussians)
    observe(density, [1.0, 0.0, 1.0])
    after = step(density, NOW, optimizer)
    assert after.count == 5
    assert torch.equal(after.means[0], gaussians.means[1])
    torch.testing.assert_close(after.scales[1:], torch.full((4, 3), 0.05 / 1.6))
    for name in ("quats", "logit_opacities", "sh", "features"):
        parents = getattr(gaussians, name)[[0, 2]]
        assert torch.equal(getattr(after, name)[1:], torch.cat([parents, parents]))
    assert not optimizer.state_dict()["moments"]["means"][:, 1:].any()


def test_children_are_drawn_from_their_parent() -> None:
    parents = make(1).detach().select(torch.zeros(4000, dtype=torch.int64))
    parents.log_scales[:] = torch.tensor([0.1, 0.01, 0.001]).log()
    children = split_gaussians(parents, torch.Generator().manual_seed(0))
    rotation = rotations(parents.quats[:1])[0]
    local = (children.means - parents.means[0]) @ rotation
    expected = torch.diag(torch.tensor([0.1, 0.01, 0.001]))
    torch.testing.assert_close(local.T.cov().sqrt().diag(), expected.diag(), rtol=0.05, atol=0.0)
    torch.testing.assert_close(local.T.corrcoef(), torch.eye(3), rtol=0.0, atol=0.05)


def test_the_border_between_clone_and_split_is_the_longest_axis() -> None:
    gaussians = make(3).detach()
    gaussians.log_scales[:] = torch.tensor([[0.1, 0.1, 0.5], [0.4, 0.4, 0.4], [0.1, 9.0, 0.1]]).log()
    clone, split = clone_or_split(gaussians, torch.tensor([True, True, False]), 0.45)
    assert clone.tolist() == [False, True, False] and split.tolist() == [True, False, False]


def test_gradients_are_averaged_over_the_views_that_see_a_gaussian() -> None:
    density = control(grow_grad2d=1.0)
    # Half image sizes 100 and 50; Gaussian 1 is seen once, 2 has a gradient that is not finite.
    grads = torch.tensor([[[0.0, 0.03], [0.015, 0.0], [math.nan, 0.0]]])
    density.observe(grads, torch.ones(1, 3, 2, dtype=torch.int32), 200, 100)
    density.observe(grads * 0.0, torch.tensor([[[1, 1], [0, 0], [1, 1]]], dtype=torch.int32), 200, 100)
    density.observe(None, torch.zeros(1, 3, 2, dtype=torch.int32), 200, 100)
    # Means: 1.5 / 2, 1.5 / 1, none.
    optimizer = with_moments(make(3))
    after = step(density, NOW, optimizer)
    assert after.count == 4 and torch.equal(after.means[3], after.means[1])


@pytest.mark.parametrize(
    ("budget", "pruned", "added"),
    [(6, [], [3]), (7, [], [1, 3]), (100, [], [0, 1, 3]), (5, [], []), (2, [], []), (5, [0], [3])],
)
def test_under_the_cap_the_largest_gradients_are_densified(budget, pruned, added) -> None:
    gaussians, density = make(5), control(max_gaussians=budget)
    gaussians.logit_opacities.detach()[pruned] = -9.0
    observe(density, [0.1, 0.2, 0.0, 0.3, 0.0])
    after = step(density, NOW, with_moments(gaussians))
    kept = [row for row in range(5) if row not in pruned]
    assert torch.equal(after.means, gaussians.means[kept + added])


@pytest.mark.parametrize("name", PARAMETERS)
def test_transparent_and_broken_ones_are_pruned(name: str) -> None:
    gaussians = make(4)
    gaussians.logit_opacities.detach()[:2] = torch.tensor([0.0049, 0.0051]).logit()
    getattr(gaussians, name).detach()[3] = math.nan
    density = control()
    observe(density, [1.0, 0.0, 0.0, 1.0])
    optimizer = with_moments(gaussians)
    after = step(density, NOW, optimizer)
    assert torch.equal(after.means, gaussians.means[1:3])
    assert optimizer.state_dict()["moments"]["sh"].shape[1] == 2


def test_large_ones_are_pruned_after_the_first_reset_only() -> None:
    for iteration, left in ((NOW, 3), (LATER, 2)):
        gaussians = make(3)
        gaussians.log_scales.detach()[1, 2] = math.log(0.21)
        assert step(control(), iteration, with_moments(gaussians)).count == left


def test_pruning_large_gaussians_leaves_some() -> None:
    gaussians = make(5, scale=1.0)
    gaussians.log_scales.detach()[:2, 0] = torch.tensor([9.0, 11.0]).log()
    after = step(control(), LATER, with_moments(gaussians))
    assert torch.equal(after.means, gaussians.means[[0, 2, 3, 4]])
    assert too_large(make(0), torch.zeros(0), 1.0, None).shape == (0,)


def test_screen_size_pruning_is_opt_in() -> None:
    for options, left in (({}, 3), ({"prune_screen_px": 20.0}, 2)):
        density, optimizer = control(**options), with_moments(make(3))
        for radii in ([5, 21, 5], [5, 3, 20]):
            each = torch.tensor(radii, dtype=torch.int32)[None, :, None].expand(1, 3, 2)
            density.observe(torch.zeros(1, 3, 2), each, 64, 48)
        assert step(density, LATER, optimizer).count == left
    assert too_large(make(1), torch.tensor([20.0]), 1.0, 20.0).tolist() == [False]


def test_no_density_change_leaves_gaussians_untouched() -> None:
    gaussians = make(3)
    optimizer = with_moments(gaussians)
    assert step(control(), NOW, optimizer) is gaussians
    density = control()
    observe(density, [1.0, 1.0, 1.0])
    for iteration in (1, 500, NOW + 1, 15_000, 30_000):
        assert step(density, iteration, optimizer) is gaussians
    assert step(density, NOW, optimizer).count == 6
    # What was observed is forgotten.
    assert step(density, NOW + 100, optimizer).count == 6
    observe(density, [0.0] * 5 + [1.0])
    assert step(density, NOW + 200, optimizer).count == 7


@pytest.mark.parametrize(("reset_to", "reached"), [(TrainingOptions.reset_opacity, True), (0.01, False)])
def test_after_a_reset_the_rim_of_a_gaussian_still_gets_gradient(reset_to: float, reached: bool) -> None:
    """Its middle lies two standard deviations outside of the image."""
    gaussians = make(1, scale=0.1, opacity=0.9)
    gaussians.means.detach()[:] = torch.tensor([-0.2, 0.0, 1.0])
    reset_opacities(gaussians, with_moments(gaussians), reset_to)
    camera, settings = Camera(40, 41, 40.0, 40.0, 0.5, 20.5), RenderSettings(0.1, "black", "reference")
    render(gaussians, camera, np.eye(4), settings, sh_degree=0, background=None)[1].sum().backward()
    assert bool(gaussians.logit_opacities.grad.any()) == reached


@pytest.mark.parametrize("n", [0, 1, 5])
def test_a_scene_without_gaussians_left_is_an_error(n: int) -> None:
    with pytest.raises(UserError, match=f"{n} Gaussians"):
        step(control(), NOW, with_moments(make(n, opacity=0.004)))


def test_a_reset_lowers_opacities_and_forgets_their_moments_alone() -> None:
    gaussians = make(3)
    gaussians.logit_opacities.detach()[:] = torch.tensor([0.9, 0.02, 0.999]).logit()
    optimizer = with_moments(gaussians)
    assert step(control(), 3_000, optimizer) is gaussians
    torch.testing.assert_close(gaussians.opacities, torch.tensor([0.05, 0.02, 0.05]))
    state = optimizer.state_dict()
    assert not state["moments"]["logit_opacities"].any()
    assert state["moments"]["means"].all() and gaussians.logit_opacities.requires_grad

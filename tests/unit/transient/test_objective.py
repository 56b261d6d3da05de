"""L_init matches the paper's formula, drives H to the residual's side, and resumes."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES
from egosplat.gaussians.training_views import read_views
from tests.unit.transient.conftest import OPTIONS, make_objective, take_steps


@torch.no_grad()
def test_the_loss_uses_valid_pixels_only(views):
    objective, weight = make_objective(transient_penalty=0.0), torch.zeros(32, 32)
    weight[:, 16:] = 1.0
    masked = replace(views, valid=weight)
    image = views.picture(0).clone()
    image[:, :16] += 0.5
    assert float(objective.loss(image, masked, 0)) == 0.0 < float(objective.loss(image, views, 0))


@pytest.mark.parametrize(("offset", "rises"), [(0.1, False), (0.5, True)])
def test_probability_follows_the_residual(views, offset, rises):
    """A pixel moves if its squared difference, of the offset, is above transient_penalty."""
    objective = make_objective()
    take_steps(objective, views, 12, offset)
    first, last = objective.mean_probability(list(range(1, 13)))[[0, -1]]
    assert (last > first + 0.05) if rises else (last < first - 0.05)


def test_the_notice_of_a_rate_that_leaves_the_network_at_its_start_names_one_that_does_not(views):
    assert "Lower transient.warmup" in OPTIONS.change(warmup=1).stays_at_start()
    told = OPTIONS.change(iterations=40, lr=1e-5).stays_at_start()
    rate = float(told.partition("transient.lr to ")[2].split()[0])
    for lr, least, most in ((1e-5, 0.4, 0.6), (rate, 0.0, 0.02)):
        objective = make_objective(iterations=40, lr=lr)
        take_steps(objective, views, 40, 0.05)
        assert least < objective.mean_probability([39, 40])[1] < most


def test_the_network_is_not_trained_in_the_warm_up(views):
    objective = make_objective(warmup=3 / 12)
    before = {name: tensor.clone() for name, tensor in objective.net.state_dict().items()}
    losses = take_steps(objective, views, 3)
    assert losses == pytest.approx([0.27] * 3, rel=1e-4)
    assert all(torch.equal(tensor, before[name]) for name, tensor in objective.net.state_dict().items())
    assert objective.mean_probability([3]).tolist() == [0.0]
    take_steps(objective, views, 1)
    assert not torch.equal(objective.net.head.weight, before["head.weight"])
    assert objective.mean_probability([3, 4])[1] > 0.0


def test_the_network_separates_what_stands_out_from_a_uniform_residual(views):
    """A residual everywhere is the camera's: nothing is transient. A part of the frame far above it is."""
    rises = []
    for part in (0.2, 0.9):
        objective = make_objective(warmup=2 / 12, recipe="own", transient_penalty=2.0)
        for number in range(12):
            image = views.picture(number % len(views)) + 0.2
            image[:8] = views.picture(number % len(views))[:8] + part
            objective.loss(image.requires_grad_(), views, number % len(views)).backward()
            objective.step()
        first, last = objective.mean_probability(list(range(1, 13)))[[2, -1]]
        rises.append(last - first)
    assert rises[0] < -0.05 and rises[1] > rises[0] + 0.05


def test_residuals_of_the_warm_up_are_kept_and_resumed(views):
    """The scale is of the warm-up, or of the first visit after it; a resumed run has the same penalties to the bit."""
    keys = {"warmup": 4 / 12, "recipe": "own", "transient_penalty": 2.0}
    unbroken, first, second = (make_objective(**keys) for _ in range(3))
    parts = [(4, 0.1), (2, 0.4), (6, 0.4)]
    losses = [take_steps(unbroken, views, *part) for part in parts]
    assert unbroken.residuals.scale.tolist() == pytest.approx([0.01] * 4 + [0.16] * 2, rel=1e-3)
    assert [take_steps(first, views, *part) for part in parts[:2]] == losses[:2]
    second.load_state_dict(first.state_dict())
    assert take_steps(second, views, *parts[2]) == losses[2]
    weights = second.net.state_dict()
    assert all(torch.equal(values, weights[name]) for name, values in unbroken.net.state_dict().items())
    assert (second.mean_probability([6, 12]) == unbroken.mean_probability([6, 12])).all()


@pytest.mark.parametrize("recipe", ["paper", "own"])
def test_a_picture_s_own_mask_leaves_pixels_out(views, recipe):
    """What is masked is far off: it gives no gradient, no residual, and H is not told that it is static."""
    masked = torch.zeros(6, 32, 32, dtype=torch.bool)
    masked[0, :, 20:] = True
    views = replace(views, transient=masked)
    one = make_objective(warmup=1 / 12, recipe=recipe)
    for _ in range(2):
        image = (views.picture(0) + 0.1 + 0.8 * masked[0, ..., None]).requires_grad_()
        one.loss(image, views, 0).backward()
        assert not image.grad[masked[0]].any() and image.grad[~masked[0]].abs().min() > 0
    if recipe == "own":
        assert float(one.residuals.scale[0]) == pytest.approx(0.01, rel=1e-3)
        assert not one.residuals.stands_out(0).any()


def test_views_at_half_the_size_keep_their_content(scene):
    valid, masked = np.ones((32, 32), bool), np.zeros((6, 32, 32), bool)
    valid[0, 0], masked[2, 5, 7] = False, True
    folder = scene(valid=valid, masked=masked)
    artifacts = [open_artifact(folder / f"{each.name}.zarr", each) for each in (FRAMES, POSES)]
    views = read_views(*artifacts, np.arange(6) >= 1, torch.device("cpu"), resolution=16)
    assert views.frame.tolist() == [1, 2, 3, 4, 5] and views.pictures[0].shape == (16, 16, 3)
    assert (views.camera.fx, views.camera.cx, views.camera.width) == (15.0, 8.0, 16)
    # A pixel of which a part lies outside the lens circle does not count, and one of which a part is masked is masked.
    assert float(views.valid[0, 0]) == 0.0 and float(views.valid.sum()) == 255.0
    assert [views.transient[view].argwhere().tolist() for view in (0, 1)] == [[], [[2, 3]]]
    assert float(views.weight(1).sum()) == 254.0 and torch.equal(views.weight(0), views.valid)
    assert len(read_views(*artifacts, np.zeros(6, bool), torch.device("cpu"), resolution=16)) == 0

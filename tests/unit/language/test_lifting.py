"""Closed-form lifting against compositing weights measured one Gaussian at a time."""

import numpy as np
import pytest
import torch

from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import view_of
from egosplat.language.dominant import lift_instances
from egosplat.language.lifting import lift
from egosplat.language.rendering import render_codes
from egosplat.rasterize.view import composite
from tests.unit.language.conftest import CAMERA, HELD_OUT


@pytest.mark.parametrize("masked", [False, True])
def test_lifted_codes_are_means_by_rendering_weight(wall, prepared, settings, masked):
    given, _ = prepared(masked)
    lifted = lift(given)
    # Each column of the identity shows where one Gaussian is rendered, and how much of it.
    codes, known, seen = torch.zeros(wall.count, 2, 3), torch.zeros(wall.count, 2), torch.zeros(wall.count)
    for index in range(len(given)):
        view = view_of(wall, given.camera, given.camera_to_world[index], settings)
        image, _ = composite(view, torch.eye(wall.count))
        targets, weight = given.targets(int(given.frame[index])), given.weight(index)
        counted = targets.known * (torch.ones(24, 24) if weight is None else weight)
        codes += torch.einsum("hwn,lchw,lhw->nlc", image, targets.codes, counted)
        known += torch.einsum("hwn,lhw->nl", image, counted)
        seen += torch.einsum("hwn,hw->n", image, torch.ones(24, 24) if weight is None else weight)
    taught = known > 1e-3
    torch.testing.assert_close(
        lifted.code, torch.where(taught[..., None], codes / known[..., None], 0.0), rtol=1e-4, atol=1e-5
    )
    torch.testing.assert_close(
        lifted.share, torch.where(taught, known / seen[:, None], 0.0), rtol=1e-4, atol=1e-5
    )


@pytest.mark.parametrize("dominant", [False, True])
def test_gaussians_in_no_view_get_no_code(wall, prepared, dominant):
    behind = wall.select(torch.arange(3))
    behind.means[:, 2] = -5.0
    views, targets = prepared(gaussians=Gaussians.concatenate([wall, behind]))
    lifted = lift_instances(views, targets) if dominant else lift(views)
    assert not lifted.share[-3:].any() and not lifted.code[-3:].any()
    assert bool(lifted.code.isfinite().all()) and bool((lifted.share <= 1).all())


def test_rendered_codes_are_those_that_were_lifted(wall, prepared, settings, camera_to_world, labels):
    lifted = lift(prepared()[0])
    found = render_codes(
        wall,
        lifted.code,
        lifted.share,
        CAMERA,
        camera_to_world[HELD_OUT],
        settings,
    )
    assert found.codes.shape == (2, 24, 24, 3) and found.coverage.shape == (2, 24, 24)
    nearest = torch.cdist(
        found.codes[1].reshape(-1, 3), torch.tensor([[1.0, 0.0, 0.5], [0.0, 1.0, -0.5]])
    ).argmin(dim=1)
    assert float((nearest.reshape(24, 24).numpy() == labels[2, 1]).mean()) > 0.95
    assert float(found.coverage.max()) <= 1.0 + 1e-5
    none = found.coverage[0] <= 1e-6
    assert bool(none.any()) and float(found.codes[0][none].abs().max()) == 0.0


def test_gaussians_without_share_do_not_contribute(wall, camera_to_world, settings, prepared):
    code = torch.zeros(wall.count, 1, 2)
    code[: wall.count // 2] = torch.tensor([1.0, 2.0])
    code[wall.count // 2 :] = 1e6
    share = torch.zeros(wall.count, 1)
    share[: wall.count // 2] = 0.25
    found = render_codes(wall, code, share, CAMERA, camera_to_world[0], settings)
    covered = found.coverage[0] > 1e-6
    assert bool(covered.any())
    values = found.codes[0][covered]
    np.testing.assert_allclose(values.numpy(), np.tile([1.0, 2.0], (len(values), 1)), rtol=1e-3)

"""Lifting of instances: each Gaussian takes the code of the instance that it shows most."""

import numpy as np
import pytest
import torch
from scipy import sparse

from egosplat.artifacts.schemas import GAUSSIANS
from egosplat.gaussians.render import view_of
from egosplat.language.centers import project_centers
from egosplat.language.dominant import lift_instances, mean_of_dominant, target_votes
from egosplat.rasterize.view import composite
from tests.unit.language.conftest import CODES


@pytest.mark.parametrize("masked", [False, True])
def test_votes_are_rendering_weights_at_centers(wall, settings, prepared, masked):
    views, targets = prepared(masked)
    votes, seen = target_votes(views, targets)
    _, owner = targets.code_rows()
    expected, total = np.zeros((wall.count, 3)), np.zeros(wall.count)
    for index in range(len(views)):
        # Each column of the identity shows where one Gaussian is rendered, and how much of it.
        view = view_of(wall, views.camera, views.camera_to_world[index], settings)
        image, _ = composite(view, torch.eye(wall.count))
        weight = views.weight(index)
        image = image if weight is None else image * weight[..., None]
        labels = targets.labels(int(views.frame[index]))
        gaussian, pixel, _ = project_centers(wall, views.camera, views.camera_to_world[index], settings)
        own = image[pixel[:, 1], pixel[:, 0], gaussian].numpy()
        for instance in range(3):
            expected[gaussian, instance] += (
                own * (labels == instance).any(dim=0).numpy()[pixel[:, 1], pixel[:, 0]]
            )
        total[gaussian] += own
    by_instance = votes.toarray() @ np.eye(3)[owner]
    np.testing.assert_allclose(by_instance, expected, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(seen, total, rtol=1e-4, atol=1e-4)


def test_each_gaussian_has_the_code_of_one_instance(wall, settings, prepared):
    """A Gaussian on the border of two instances has the code of the larger part, not a mean."""
    views, targets = prepared()
    found = lift_instances(views, targets)
    votes, _ = target_votes(views, targets)
    votes = votes.toarray() @ np.eye(3)[targets.code_rows()[1]]
    assert found.decoded == GAUSSIANS and found.levels == ["part", "whole"]
    shown = found.share[:, 1] > 0
    larger = torch.from_numpy(votes[:, [0, 1]].argmax(axis=1))
    torch.testing.assert_close(found.code[shown, 1], torch.from_numpy(CODES)[larger[shown]])
    middle = found.share[:, 0] > 0
    assert bool(middle.any())
    torch.testing.assert_close(
        found.code[middle, 0], torch.from_numpy(CODES[2]).expand(int(middle.sum()), -1)
    )
    assert float(found.share.min()) >= 0.0 and float(found.share.max()) <= 1.0
    far = wall.means[:, 1].abs() > 1.2  # no instance at level 0 there
    assert float(found.share[far, 0].max()) == 0.0 and float(found.code[far, 0].abs().max()) == 0.0


def test_a_code_is_the_mean_of_the_views_of_the_dominant_instance():
    """Weights 3 and 1 on two views of instance 5; weight 3.5 on another instance does not count."""
    votes = sparse.csr_array(np.array([[3.0, 1.0, 3.5], [0.0, 0.0, 2.0], [0.0, 0.0, 0.0]], np.float32))
    codes = np.array([[1.0, 0.0], [0.0, 4.0], [7.0, 7.0]], np.float32)
    code, known = mean_of_dominant(votes, np.array([5, 5, 2]), codes)
    np.testing.assert_allclose(code, [[0.75, 1.0], [7.0, 7.0], [0.0, 0.0]])
    np.testing.assert_allclose(known, [7.5, 2.0, 0.0])


def test_an_instance_without_views_has_no_code(prepared):
    rows = [(instance, frame) for instance in (0, 1) for frame in (0, 1, 3, 4)]
    views, targets = prepared(target="view", rows=rows)
    found = lift_instances(views, targets)
    assert not found.share[:, 0].any() and not found.code[:, 0].any()
    assert float(found.share[:, 1].max()) == pytest.approx(1.0)

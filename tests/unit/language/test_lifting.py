"""Target codes of pixels, and lifted codes, of pixels or of instances, against compositing weights measured one Gaussian at a time."""

import numpy as np
import pytest
import torch
from scipy import sparse

from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import view_of
from egosplat.language import dominant as module
from egosplat.language.centers import look_at_centers
from egosplat.language.dominant import lift_instances, sum_votes
from egosplat.rasterize.view import composite, render_codes
from egosplat_rivals.splat_feature_solver import lift
from tests.support.gaussian_scene import SETTINGS
from tests.support.scenes import LEVELS
from tests.unit.language.conftest import CAMERA, CODES, HELD_OUT


def test_pixels_have_the_code_of_their_instance(prepared, labels):
    found = prepared()[1].of(0)
    assert found.codes.shape == (2, 3, 24, 24) and found.known.shape == (2, 24, 24)
    assert torch.equal(found.known, torch.from_numpy(labels[0] >= 0))
    left = torch.from_numpy(labels[0, 1] == 0)
    assert found.codes[1][:, left].T.unique(dim=0).tolist() == [[1.0, 0.0, 0.5]]
    assert float(found.codes[0][:, ~found.known[0]].abs().max()) == 0.0


def test_only_with_aggregation_a_view_too_small_to_be_encoded_has_the_consistent_code(prepared, labels):
    assert bool(prepared(rows=[(0, 0)])[1].of(0).known[1].all())
    alone = prepared(target="view", rows=[(0, 0)])[1].of(0)
    assert torch.equal(alone.known[1], torch.from_numpy(labels[0, 1] == 0)) and not alone.known[0].any()


def test_a_level_without_instances_is_no_target(prepared, labels):
    every = prepared(levels=(1, 1, 1))[1]
    found = every.of(0)
    assert every.levels == LEVELS[1:2]
    assert found.codes.shape == (1, 3, 24, 24)
    assert torch.equal(found.known, torch.from_numpy(labels[0, 1:2] >= 0))


@pytest.fixture(params=[False, True], ids=["every pixel", "masked"])
def alone(request, prepared):
    """Views, targets, and of each view the (24, 24, N) weights with which each Gaussian is shown."""
    views, targets = prepared(request.param)
    images = []
    for index in range(len(views)):
        # Each column of the identity shows where one Gaussian is rendered, and how much of it.
        image, _ = composite(views.view(index), torch.eye(views.gaussians.count))
        weight = views.weight(index)
        images.append(image if weight is None else image * weight[..., None])
    return views, targets, images


def test_lifted_codes_are_means_by_rendering_weight(alone):
    views, _, images = alone
    (lifted, share), count = lift(views), views.gaussians.count
    codes, known, seen = torch.zeros(count, 2, 3), torch.zeros(count, 2), torch.zeros(count, 1)
    for frame, image in zip(views.frame, images, strict=True):
        targets = views.targets(int(frame))
        counted = targets.known.float()
        codes += torch.einsum("hwn,lchw,lhw->nlc", image, targets.codes, counted)
        known += torch.einsum("hwn,lhw->nl", image, counted)
        seen += image.sum(dim=(0, 1))[:, None]
    taught = known > 1e-3
    code = torch.where(taught[..., None], codes / known[..., None], 0.0)
    torch.testing.assert_close(lifted, code, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(share, torch.where(taught, known / seen, 0.0), rtol=1e-4, atol=1e-5)


def test_votes_are_rendering_weights_at_centers_however_many_views_are_held(alone, monkeypatch):
    (views, targets, images), found = alone, []
    for views_at_once in (1000, 2, 1):
        monkeypatch.setattr(module, "_VIEWS_AT_ONCE", views_at_once)
        pairs, seen = sum_votes(views, targets)
        found.append([*pairs, seen])
    assert all(np.array_equal(*both) for other in found[1:] for both in zip(found[0], other, strict=True))
    expected, total = np.zeros((views.gaussians.count, 3)), np.zeros(views.gaussians.count)
    for frame, pose, image in zip(views.frame, views.camera_to_world, images, strict=True):
        centers = look_at_centers(views.gaussians, CAMERA, pose, SETTINGS)
        gaussian, (column, row) = centers.gaussian, centers.pixel.T
        own = image[row, column, gaussian].numpy()
        labels = targets.labels(int(frame)).numpy()[:, row, column]
        expected[gaussian] += own[:, None] * (labels[..., None] == np.arange(3)).any(axis=0)
        total[gaussian] += own
    np.testing.assert_allclose(by_instance(pairs, seen), expected, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(seen, total, rtol=1e-4, atol=1e-4)


def by_instance(pairs, seen) -> np.ndarray:
    """(N, 3) weights of each Gaussian on each instance."""
    return sparse.csr_array((pairs[3], pairs[:2]), (len(seen), 3)).toarray()


def test_each_gaussian_has_the_code_of_one_instance(wall, prepared):
    """A Gaussian on the border of two instances has the code of the larger part, not a mean."""
    views, targets = prepared()
    found = lift_instances(views, targets)
    votes = by_instance(*sum_votes(views, targets))
    assert found.levels == ["part", "whole"]
    middle, shown = (found.share > 0).T
    larger = torch.from_numpy(CODES[votes[:, :2].argmax(axis=1)])
    torch.testing.assert_close(found.code[shown, 1], larger[shown])
    torch.testing.assert_close(found.code[middle, 0], torch.from_numpy(CODES)[[2] * int(middle.sum())])
    assert bool(middle.any()) and float(found.share.min()) >= 0.0 and float(found.share.max()) <= 1.0
    far = wall.means[:, 1].abs() > 1.2  # no instance at level 0 there
    assert not found.share[far, 0].any() and not found.code[far, 0].any()


def test_an_instance_without_views_has_no_code(prepared):
    rows = [(instance, frame) for instance in (0, 1) for frame in (0, 1, 3, 4)]
    found = lift_instances(*prepared(target="view", rows=rows))
    assert not found.share[:, 0].any() and not found.code[:, 0].any()
    assert float(found.share[:, 1].max()) == pytest.approx(1.0)


def test_gaussians_in_no_view_get_no_code(wall, prepared):
    behind = wall.select(torch.arange(3))
    behind.means[:, 2] = -5.0
    views, targets = prepared(gaussians=Gaussians.concatenate([wall, behind]))
    one = lift_instances(views, targets)
    for code, share in (lift(views), (one.code, one.share)):
        assert not share[-3:].any() and not code[-3:].any()
        assert bool(code.isfinite().all()) and bool((share <= 1).all())


def test_rendered_codes_are_those_that_were_lifted(wall, prepared, camera_to_world, labels):
    lifted = lift(prepared()[0])
    codes, coverage = render_codes(view_of(wall, CAMERA, camera_to_world[HELD_OUT], SETTINGS), *lifted)
    assert codes.shape == (2, 24, 24, 3) and coverage.shape == (2, 24, 24)
    nearest = torch.cdist(codes[1], torch.from_numpy(CODES[:2])[None]).argmin(dim=2).numpy()
    assert (nearest == labels[HELD_OUT, 1]).mean() > 0.95 and float(coverage.max()) <= 1.0 + 1e-5
    none = coverage[0] <= 1e-6
    assert bool(none.any()) and float(codes[0][none].abs().max()) == 0.0


def test_gaussians_without_share_do_not_contribute(wall, camera_to_world):
    shown = torch.arange(wall.count)[:, None] < wall.count // 2
    code = torch.where(shown[..., None], torch.tensor([1.0, 2.0]), 1e6)
    codes, coverage = render_codes(view_of(wall, CAMERA, camera_to_world[0], SETTINGS), code, 0.25 * shown)
    values = codes[0][coverage[0] > 1e-6].numpy()
    assert len(values)
    np.testing.assert_allclose(values, np.tile([1.0, 2.0], (len(values), 1)), rtol=1e-3)

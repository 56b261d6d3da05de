"""Weights and median depths at projected centers, against the definition in float64 and by hand."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.geometry import Camera
from egosplat.language.centers import look_at_centers
from egosplat.rasterize.view import View, own_weights, pixel_lists
from egosplat_rivals.surface import median_depths
from tests.support.gaussian_scene import SETTINGS
from tests.support.splats import blobs, crowd

CAMERA = Camera(60, 40, 50.0, 50.0, 30.0, 20.0)


CROWD = crowd()


def settings(backend: str) -> RenderSettings:
    return replace(SETTINGS, backend=backend)


def dense(begin: torch.Tensor, ids: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
    """(P, 300) weights of the lists of P pixels."""
    found = torch.zeros(len(begin) - 1, 300).double()
    found[torch.repeat_interleave(begin.diff()), ids] = weights.double()
    return found


def test_kernels_list_what_the_reference_shows_in_float64():
    pixels = torch.cartesian_prod(torch.arange(0, 60, 7), torch.arange(0, 40, 6))
    geometry = [each.double() for each in (CROWD.means, CROWD.quats, CROWD.scales, CROWD.opacities)]
    matrices = torch.eye(4).double()[None], torch.from_numpy(CAMERA.matrix)[None]
    exact = View(*geometry, geometry[0], *matrices, 60, 40, backend="reference")
    views = view_of(CROWD, CAMERA, np.eye(4), settings("cpu")), exact
    lists = [pixel_lists(view, pixels) for view in views]
    assert int((dense(*lists[1]) > 0).sum()) > 300
    torch.testing.assert_close(dense(*lists[0]), dense(*lists[1]), rtol=1e-4, atol=1e-5)
    medians = [median_depths(*each, CROWD.means[:, 2].double()) for each in lists]
    assert 5 < int(medians[0].isnan().sum()) < len(pixels) - 5
    torch.testing.assert_close(*medians, equal_nan=True)


@pytest.mark.parametrize(
    ("depths", "opacities", "weights", "median"),
    [
        # Opacity 0.4 leaves a transmittance of 0.6, and 0.9 behind it leaves 0.06: the second is the median.
        ([2.0, 3.0], [0.4, 0.9], [0.4, 0.6 * 0.9], 3.0),
        ([2.0], [0.4], [0.4], np.nan),
        # Two opacities of 0.995 end the pixel: their transmittance is below 1e-4.
        ([2.0, 2.1, 2.2, 3.0], [0.995] * 3 + [0.9], [0.995, 0.005, 0.0, 0.0], 2.0),
    ],
)
def test_weights_and_median_depth_of_blobs_in_a_row(depths, opacities, weights, median):
    row = blobs([[0.0, 0.0, depth] for depth in depths], opacities)
    found = look_at_centers(row, CAMERA, np.eye(4), SETTINGS)
    assert found.pixel.tolist() == [[30, 20]] * len(depths)
    # The center lies at the corner of its pixel, half a pixel from the pixel's center.
    np.testing.assert_allclose(found.weight, weights, rtol=0.02, atol=0.01)
    lists = pixel_lists(view_of(row, CAMERA, np.eye(4), SETTINGS), torch.from_numpy(found.pixel[:1]))
    np.testing.assert_allclose(median_depths(*lists, row.means[:, 2].double()), [median])
    assert not found.weight[3:].any()


@pytest.mark.parametrize(
    ("means", "gaussian", "pixel"),
    [
        ([[0.0, 0.0, -2.0], [9.0, 0.0, 2.0], [0.0, 0.0, 0.05], [0.2, 0.0, 2.0]], [3], [[35, 20]]),
        ([[0.0, 0.0, -2.0]], [], []),
    ],
)
def test_centers_behind_the_camera_and_outside_the_image_are_left_out(means, gaussian, pixel):
    found = look_at_centers(blobs(means, [0.9] * len(means)), CAMERA, np.eye(4), SETTINGS)
    assert (found.gaussian.tolist(), found.pixel.tolist()) == (gaussian, pixel)
    assert found.weight.shape == (len(gaussian),)


@pytest.mark.parametrize("width, height", [(60, 40), (67, 33)])
def test_own_weights_are_those_of_the_lists(width, height):
    """Near the centers, also in tiles that the image cuts, and for Gaussians without a pixel in the image."""
    size = torch.tensor([width, height])
    centers = CAMERA.project(CROWD.means.double().numpy())
    pixels = torch.from_numpy(np.floor(centers + np.random.default_rng(5).normal(0, 5, (300, 2)))).long()
    pixels[::7] = torch.tensor([-1, -1])
    pixels[1::7] = size
    camera = Camera(width, height, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    view = view_of(CROWD, camera, np.eye(4), settings("cpu"))
    inside = ((pixels >= 0) & (pixels < size)).all(dim=1)
    wanted = torch.zeros(300)
    wanted[inside] = dense(*pixel_lists(view, pixels[inside]))[:, inside].diagonal().float()
    assert int((wanted > 0).sum()) > 20 and int((wanted[inside] == 0).sum()) > 20
    for backend in ("cpu", "reference"):
        found = own_weights(view_of(CROWD, camera, np.eye(4), settings(backend)), pixels)
        torch.testing.assert_close(found, wanted, rtol=1e-4, atol=1e-6)


def test_own_weights_need_a_pixel_for_each_gaussian():
    with pytest.raises(ValueError, match=r"\(299, 2\).*\(300, 2\)"):
        own_weights(view_of(CROWD, CAMERA, np.eye(4), SETTINGS), torch.zeros(299, 2).long())

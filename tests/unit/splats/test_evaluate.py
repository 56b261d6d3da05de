"""PSNR and SSIM of renders."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from egosplat.geometry import Camera
from egosplat.splats.evaluate import evaluate, picture_scores, rendered
from egosplat.splats.options import RenderOptions
from egosplat.splats.views import Views

OPTIONS = RenderOptions(near_plane=0.1, background="black", antialiased=False, backend="auto")


def picture(seed: int = 0) -> torch.Tensor:
    return torch.rand(24, 24, 3, generator=torch.Generator().manual_seed(seed))


@pytest.fixture
def views(pictures, camera_to_world) -> Views:
    camera = Camera(24, 24, 22.0, 22.0, 12.0, 12.0)
    rows = np.array([2, 6])
    device = torch.device("cpu")
    return Views(rows, torch.from_numpy(pictures[rows]), camera_to_world[rows], None, None, camera, device)


def test_equal_pictures_are_perfect():
    psnr, ssim = picture_scores(picture(), picture(), None)
    assert psnr == math.inf and ssim == pytest.approx(1.0, abs=1e-6)


def test_an_error_of_a_tenth_is_20_decibels():
    truth = picture() * 0.8
    psnr, ssim = picture_scores(truth + 0.1, truth, None)
    assert psnr == pytest.approx(20.0, abs=1e-3) and 0.5 < ssim < 1.0


def test_invalid_pixels_do_not_count():
    image, truth, weight = picture(1) * 0.5, picture(2), torch.ones(24, 24)
    weight[:, :8] = 0.0
    expected = picture_scores(image, truth, weight)
    other = image.clone()
    other[:, :8] = 1.0
    assert picture_scores(other, truth, weight) == expected
    error = ((image - truth)[:, 8:] ** 2).mean()
    assert expected[0] == pytest.approx(-10 * math.log10(error), abs=1e-3)
    assert expected[1] > picture_scores(image, truth, None)[1]


def test_the_true_gaussians_render_the_pictures(truth, views):
    shown = {}
    scores = evaluate(truth, views, OPTIONS, 0, shown.__setitem__)
    assert scores.psnr.min() > 50 and scores.ssim.min() > 0.999  # pictures have 8 bits
    assert scores.mean_psnr == pytest.approx(scores.psnr.mean())
    assert sorted(shown) == [0, 1] and shown[1].dtype == np.uint8
    np.testing.assert_array_equal(shown[1], views.pictures[1].numpy())
    moved = views.camera_to_world.copy()
    moved[:, 1, 3] += 0.3
    worse = evaluate(truth, replace(views, camera_to_world=moved), OPTIONS, 0)
    assert worse.psnr.max() < scores.psnr.min() - 10


@pytest.mark.parametrize("background, value", [("black", 0.0), ("random", 0.0), ("white", 1.0)])
def test_the_background_of_evaluation(truth, views, background, value):
    behind = truth.select(torch.arange(1))
    behind.means[:, 2] = -5.0
    options = RenderOptions(near_plane=0.1, background=background, antialiased=False, backend="auto")
    image = rendered(behind, views, 0, options, 0)
    assert image.shape == (24, 24, 3) and bool((image == value).all())


def test_without_views_the_means_are_not_a_number(truth, views):
    none = replace(views, frame=views.frame[:0], pictures=views.pictures[:0])
    scores = evaluate(truth, none, OPTIONS, 0)
    assert math.isnan(scores.mean_psnr) and math.isnan(scores.mean_ssim)

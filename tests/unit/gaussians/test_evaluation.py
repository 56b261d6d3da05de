"""Scores of renders: valid pixels, background, and agreement with the benchmark's scores."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from egosplat.evaluation.evaluation_frames import region_scores
from egosplat.gaussians.evaluation import develop, evaluate, mean_known
from egosplat.gaussians.render import RenderSettings, TrainedScene
from egosplat.gaussians.training_views import Views
from tests.support.gaussian_scene import CAMERA, SETTINGS, views_of


@pytest.fixture
def views(pictures, camera_to_world) -> Views:
    return views_of(pictures, camera_to_world, 2, 6)


def test_the_benchmark_has_the_same_scores_of_the_same_render(truth, views):
    """splats.png and metrics.json report the same number, with invalid pixels and an imperfect render."""
    valid = np.hypot(*(np.mgrid[:24, :24] - 11.5)) < 10
    moved = views.camera_to_world.copy()
    moved[:, 1, 3] += 0.1
    lens = replace(views, valid=torch.from_numpy(valid).float(), camera_to_world=moved)
    renders = {}
    psnr, ssim = evaluate(TrainedScene(truth, SETTINGS, CAMERA, 0), lens, renders.__setitem__)
    for index, render in renders.items():
        found = region_scores(render, views.pictures[index].numpy(), valid, {"all": valid})["all"]
        assert (found.psnr, found.ssim) == (psnr[index], ssim[index])
        assert 10 < found.psnr < 40 and found.ssim < 0.99


def test_the_true_gaussians_render_the_pictures(truth, views):
    scene, shown = TrainedScene(truth, SETTINGS, CAMERA, 0), {}
    psnr, ssim = evaluate(scene, views, shown.__setitem__)
    assert psnr.min() > 50 and ssim.min() > 0.999  # pictures have 8 bits
    assert mean_known(psnr) == pytest.approx(psnr.mean())
    assert sorted(shown) == [0, 1] and shown[1].dtype == np.uint8
    np.testing.assert_array_equal(shown[1], views.pictures[1].numpy())
    moved = views.camera_to_world.copy()
    moved[:, 1, 3] += 0.3
    worse, _ = evaluate(scene, replace(views, camera_to_world=moved))
    assert worse.max() < psnr.min() - 10
    nothing = evaluate(scene, replace(views, frame=views.frame[:0], pictures=views.pictures[:0]))
    assert all(math.isnan(mean_known(values)) for values in nothing)


@pytest.mark.parametrize("background, value", [("black", 0), ("white", 255)])
def test_evaluation_renders_on_the_background_of_training(truth, views, background, value):
    behind = truth.select(torch.arange(1))
    behind.means[:, 2] = -5.0
    options = RenderSettings(near_plane=0.1, background=background, backend="auto")
    scene = TrainedScene(behind, options, CAMERA, 0)
    image = develop(scene, CAMERA, views.camera_to_world[0], None, None)
    assert image.shape == (24, 24, 3) and bool((image == value).all())

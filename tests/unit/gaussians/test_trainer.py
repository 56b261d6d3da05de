"""The training loop learns, resumes identically, stops when it diverges, passes its options on, and runs on the device that can."""

import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.errors import UserError
from egosplat.frames.images import read_rgb
from egosplat.gaussians.initialization import from_points
from egosplat.gaussians.loss import L1Ssim
from egosplat.gaussians.model import PARAMETERS, Gaussians
from egosplat.gaussians.schedule import STOCK, TrainingOptions
from egosplat.gaussians.trainer import TrainingState, resume_and_train
from egosplat.rasterize import api as device
from egosplat.rasterize.api import training_device
from tests.support.gaussian_scene import SETTINGS, views_of

OPTIONS = TrainingOptions(render=SETTINGS, iterations=60, max_gaussians=80, evaluate_every=20, seed=3)
EXTENT = 1.0


@pytest.fixture
def view_sets(pictures, camera_to_world) -> list:
    return [views_of(pictures, camera_to_world, *rows) for rows in ((0, 1, 3, 5, 7, 8), (4,))]


@pytest.fixture
def start(points) -> Gaussians:
    xyz, rgb = points
    return from_points(xyz, np.full_like(rgb, 128), sh_degree=1, max_points=1000, seed=0)


@pytest.fixture
def trained(view_sets, start, tmp_path):
    """``trained(...)``: the state after training a copy of the same start; keywords change the options."""

    def run(view_sets: list = view_sets, **changes: object) -> TrainingState:
        options = replace(OPTIONS, **changes)
        state = TrainingState(start.select(torch.arange(start.count)), options, EXTENT, L1Ssim(0.2))
        resume_and_train(state, *view_sets, Checkpoint(tmp_path / "none.zarr", "", 3600.0), shown=True)
        return state

    return run


def same(left: Gaussians, right: Gaussians) -> bool:
    pairs = ((getattr(left, name), getattr(right, name)) for name in PARAMETERS)
    return left.count == right.count and all(torch.equal(*pair) for pair in pairs)


def test_training_lowers_the_error_on_all_frames(trained, view_sets, tmp_path):
    state = trained(iterations=200, evaluate_every=100)
    photograph, shown = np.split(read_rgb(Checkpoint(tmp_path / "none.zarr", "").picture) / 255.0, 2, axis=1)
    assert np.abs(photograph - view_sets[0].picture(3).numpy()).max() < 0.01
    assert np.square(shown - photograph).mean() < 0.3 * np.var(photograph)
    curves = state.curves
    assert curves.evaluated == [100, 200] and curves.psnr[1] > curves.psnr[0]
    assert curves.psnr[1] > 24.0 and curves.ssim[1] > 0.8
    assert curves.iteration == list(range(10, 201, 10)) and curves.loss[-1] < 0.3 * curves.loss[0]
    assert state.gaussians.count == curves.gaussians[-1] <= 80
    assert curves.gaussians[-1] > curves.gaussians[0]


def test_every_view_comes_once_an_epoch(start):
    state = TrainingState(start, OPTIONS, EXTENT, L1Ssim(0.2))
    epochs = [[state.next_view(6) for _ in range(6)] for _ in range(3)]
    assert all(sorted(epoch) == list(range(6)) for epoch in epochs)
    assert epochs[0] != epochs[1] or epochs[1] != epochs[2]


def test_pixels_outside_the_lens_circle_do_not_matter(trained, view_sets):
    weight = torch.ones(24, 24)
    weight[:, :14] = 0.0
    views = replace(view_sets[0], valid=weight)
    other = views.pictures.clone()
    other[:, :, :4] = 255  # windows of SSIM that have a valid pixel begin at column 4
    dark = trained([views, view_sets[1]])
    bright = trained([replace(views, pictures=other), view_sets[1]])
    assert same(dark.gaussians, bright.gaussians)
    unmasked = trained([replace(views, valid=None, pictures=other), view_sets[1]])
    assert not same(dark.gaussians, unmasked.gaussians)


def test_a_scene_outside_all_cameras_trains_without_error(trained, start):
    start.means[:, 2] = -3.0
    assert same(trained(iterations=15).gaussians, start)


def test_options_scale_the_schedule():
    stock = replace(OPTIONS, iterations=3000).schedule
    assert stock.densify_until == STOCK.densify_until // 10 and stock.position_lr_init == 1.6e-4
    assert replace(OPTIONS, iterations=3000, cuts_schedule=True).schedule.densify_until == 3000


def test_options_reach_density_control(trained):
    short = {"iterations": 5, "evaluate_every": 5}
    begins = replace(OPTIONS, **short).schedule.densify_from
    assert 0 < begins <= 5
    lowered = trained(**short, reset_at_start=True, reset_opacity=0.02).gaussians.opacities
    assert lowered.max().item() < 0.08 < trained(**short).gaussians.opacities.min().item()


def test_nothing_is_scored_just_after_a_reset(trained):
    """Gaussians are nearly transparent then: a run of 30,000 iterations would report 10 dB every 3,000."""
    begins = replace(OPTIONS, iterations=12).schedule.densify_from
    assert 0 < begins < 6
    options = {"iterations": 12, "evaluate_every": begins, "reset_opacity": 0.02}
    every = list(range(begins, 13, begins))
    assert trained(**options).curves.evaluated == every
    assert trained(**options, reset_at_start=True).curves.evaluated == every[1:]


@pytest.fixture
def no_gsplat(monkeypatch):
    """A machine with a GPU that lacks gsplat."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setitem(sys.modules, "gsplat", None)


def test_auto_takes_a_gpu_that_renders_or_says_why_not(no_gsplat, capsys, monkeypatch):
    assert training_device("auto").type == "cpu"
    assert 'pip install "egosplat[cuda]"' in capsys.readouterr().err
    monkeypatch.setattr(device, "load_gsplat", lambda: object())
    assert training_device("auto").type == "cuda"


def test_only_a_gpu_that_is_asked_for_must_render(no_gsplat):
    with pytest.raises(UserError, match="gsplat cannot be loaded"):
        training_device("cuda")
    assert training_device("cpu").type == training_device("reference").type == "cpu"

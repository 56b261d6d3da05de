"""Corrections of poses and exposures at half a turn, for one frame, and at gains of 0 and 1e6."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from egosplat.gaussians.corrections import COLUMNS, applied, corrected, make_corrections
from egosplat.gaussians.exposure import expose
from egosplat.gaussians.fitting import fit
from egosplat.gaussians.initialization import from_points
from egosplat.gaussians.loss import l1_ssim
from egosplat.gaussians.render import TrainedScene
from egosplat.gaussians.training_views import Views
from egosplat.geometry import Camera
from egosplat.pipeline.shared_options import CameraOptions
from tests.support.gaussian_scene import SETTINGS

BOTH = CameraOptions(refine_poses="on", compensate_exposure="on")


@pytest.mark.numerics("pose correction: rotation vector of 0 to 2 pi rad, and 1e-300", within=1e-14)
@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-9, 9.9e-5, 1.1e-4, 1.0, np.pi, 6.28])
def test_rotation_and_its_gradient(measured, angle):
    axis = np.array([0.6, -0.64, 0.48])
    vector = torch.from_numpy(np.concatenate([np.zeros(3), axis * angle])).requires_grad_()
    rotation = corrected(torch.eye(4, dtype=torch.float64), vector)[:3, :3]
    measured(np.abs(rotation.detach().numpy() - Rotation.from_rotvec(axis * angle).as_matrix()).max())
    rotation.sum().backward()
    assert bool(vector.grad.isfinite().all())


def one_frame(brightness: int) -> Views:
    picture = torch.full((1, 24, 24, 3), brightness, dtype=torch.uint8)
    camera, frame = Camera(24, 24, 22.0, 22.0, 12.0, 12.0), np.zeros(1, np.int64)
    return Views(frame, picture, np.eye(4)[None].copy(), None, None, camera, torch.device("cpu"))


@pytest.mark.numerics("corrections of one frame; of a black frame", outside="stay 0; gain e^-5")
@pytest.mark.parametrize("brightness", [0, 128, 255])
def test_one_frame(brightness):
    views = one_frame(brightness)
    xyz = np.random.default_rng(0).uniform([-1, -1, 1.8], [1, 1, 2.2], (40, 3))
    start = from_points(xyz, np.full((40, 3), 120, np.uint8), sh_degree=0, max_points=40, seed=0)
    corrections = make_corrections(BOTH, start, views, 0.1, 100)
    corrections.camera_to_world(0)
    corrections.exposed(torch.rand(24, 24, 3), views.picture(0)).sum().backward()
    corrections.step(0, 1)
    assert not corrections.values.any() and int(corrections.steps[0]) == 1
    zero = torch.zeros(1, COLUMNS, dtype=torch.float64)
    found = fit(TrainedScene(start, SETTINGS, views.camera, 0), views, zero, corrections)
    assert bool(found.isfinite().all()) and found.abs().max() < 6.0
    assert np.isfinite(applied(views, found).camera_to_world).all()
    assert brightness or float(found[0, 6:].max()) < 0.0


@pytest.mark.numerics(
    "gain of 1e-6 to 1e6, and 0", outside="0: black, gradient 0; render above 1e8: weight 0"
)
@pytest.mark.parametrize("gain", [0.0, 1e-6, 1.0, 1e6, 1e12])
def test_gains(gain):
    log_gain = torch.full((3,), gain, dtype=torch.float64).log().requires_grad_()
    image = torch.rand(24, 24, 3, generator=torch.Generator().manual_seed(0)).requires_grad_()
    loss = l1_ssim(expose(image, log_gain), torch.full((24, 24, 3), 0.5), None, 0.2)
    loss.backward()
    assert bool(loss.isfinite())
    assert bool(image.grad.isfinite().all()) and bool(log_gain.grad.isfinite().all())
    assert gain or not image.grad.any()


@pytest.mark.numerics(
    "tone curve: color of 0 to 1e20, gain of 1e-6 to 1e6, k of 0 to 4",
    outside="color above 10: the gain of 10",
)
@pytest.mark.parametrize("color", [0.0, 1e-30, 1.0, 1e20])
@pytest.mark.parametrize("log_gain", [-13.8, 0.0, 13.8])
@pytest.mark.parametrize("compression", [0.0, 1.0, 4.0])
def test_compression(color, log_gain, compression):
    leaves = [
        torch.full(shape, value, requires_grad=True)
        for shape, value in (((2, 2, 3), color), ((3,), log_gain), ((1,), compression))
    ]
    found = expose(*leaves)
    assert bool(found.isfinite().all()) and bool((found >= 0).all())
    found.mean().backward()
    assert all(bool(leaf.grad.isfinite().all()) for leaf in leaves)


@pytest.mark.numerics("pose gradient that is not finite", outside="correction stays")
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_broken_gradient(value):
    views = one_frame(100)
    start = from_points(np.ones((3, 3)), np.zeros((3, 3), np.uint8), sh_degree=0, max_points=3, seed=0)
    corrections = make_corrections(BOTH, start, views, 0.1, 100)
    (corrections.camera_to_world(0).sum() * value).backward()
    corrections.step(0, 1)
    assert not corrections.values.any() and not corrections.steps.any()


@pytest.mark.numerics("pose correction of 180° about any axis, 1e6 m away", within=1e-9)
@pytest.mark.parametrize("seed", range(3))
def test_half_a_turn(measured, seed):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn.as_matrix(), rng.normal(size=3) * 1e6
    axis = rng.normal(size=3)
    axis *= np.pi / np.linalg.norm(axis)
    found = corrected(
        torch.from_numpy(pose), torch.from_numpy(np.concatenate([[0.01, 0.0, 0.0], axis]))
    ).numpy()
    expected = (Rotation.from_rotvec(axis) * turn).as_matrix()
    measured(np.abs(found[:3, :3] - expected).max())
    measured(np.abs(found[:3, 3] - pose[:3, 3] - [0.01, 0.0, 0.0]).max())

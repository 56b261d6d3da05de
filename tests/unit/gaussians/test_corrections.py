"""Corrections of poses and exposures: their gradient, their mean, what they undo, and how they resume."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.gaussians import fitting
from egosplat.gaussians.corrections import (
    COLUMNS,
    Corrections,
    applied,
    corrected,
    make_corrections,
    predicts,
    resolve_camera,
)
from egosplat.gaussians.evaluation import evaluate, mean_known
from egosplat.gaussians.exposure import expose
from egosplat.gaussians.initialization import from_points
from egosplat.gaussians.loss import L1Ssim
from egosplat.gaussians.render import TrainedScene, render
from egosplat.gaussians.schedule import TrainingOptions
from egosplat.gaussians.trainer import TrainingState, resume_and_train
from egosplat.geometry import make_pose
from egosplat.pipeline.shared_options import CameraOptions
from tests.support.gaussian_scene import CAMERA, SETTINGS, Stopped, StoppingCheckpoint, opaque, views_of

OFF = CameraOptions(refine_poses="off", compensate_exposure="off")
BOTH = CameraOptions(refine_poses="on", compensate_exposure="on")
OPTIONS = TrainingOptions(render=SETTINGS, iterations=60, max_gaussians=60, evaluate_every=30, seed=3)


def view_sets(pictures, poses) -> list:
    return [views_of(pictures, poses, *rows) for rows in ((0, 1, 2, 3, 5, 6, 7, 8), (4,))]


@pytest.fixture
def start(points):
    return from_points(*points, sh_degree=0, max_points=1000, seed=0)


@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_the_gradient_of_a_pose_is_that_of_finite_differences(points, camera_to_world, backend):
    # At depths far apart, so that no step changes the order in which Gaussians are composited.
    xyz = points[0][:5] * np.linspace(0.5, 1.5, 5)[:, None]
    few = opaque(xyz, points[1][:5], logit=2.0)
    pose = torch.from_numpy(camera_to_world[2])
    weights = torch.linspace(-1.0, 2.0, 24, dtype=torch.float64)[:, None, None] * torch.ones(1, 24, 3)

    def total(correction: torch.Tensor, backend: str) -> torch.Tensor:
        settings = replace(SETTINGS, backend=backend)
        found = render(few, CAMERA, corrected(pose, correction), settings, sh_degree=0, background=None)
        return (found[0].double() * weights).sum()

    at = torch.tensor([0.01, -0.02, 0.03, 0.02, -0.01, 0.015], dtype=torch.float64)
    leaf = at.clone().requires_grad_()
    total(leaf, backend).backward()
    step = 0.01
    steps = torch.eye(6, dtype=torch.float64) * step
    slopes = [
        float(total(at + one, "reference") - total(at - one, "reference")) / (2 * step) for one in steps
    ]
    np.testing.assert_allclose(leaf.grad.numpy(), slopes, atol=0.02 * float(leaf.grad.norm()))


def test_a_correction_of_zero_is_the_pose_itself(camera_to_world):
    pose = make_pose(Rotation.from_rotvec([0.3, 1.0, -0.2]).as_matrix(), np.array([1.0, 2.0, 3.0]))
    same = corrected(torch.from_numpy(pose), torch.zeros(6, dtype=torch.float64))
    np.testing.assert_array_equal(same.numpy(), pose)


def test_wrong_poses_and_exposures_are_corrected(start, pictures, camera_to_world, tmp_path):
    rng = np.random.default_rng(5)
    error = torch.zeros(9, COLUMNS, dtype=torch.float64)
    error[:, :2] = torch.from_numpy(rng.normal(scale=0.03, size=(9, 2)))
    error[:, 6:] = torch.from_numpy(rng.normal(scale=0.2, size=(9, 1)))
    error -= error.mean(dim=0)
    poses = corrected(torch.from_numpy(camera_to_world), -error[:, :6]).numpy()
    dark = (pictures * error[:, None, None, 6:].exp().numpy()).clip(0, 255).astype(np.uint8)
    sets = view_sets(dark, poses)
    options = replace(OPTIONS, iterations=400, evaluate_every=400)

    def held_out(corrections: Corrections | None) -> float:
        state = TrainingState(start.select(torch.arange(start.count)), options, 1.0, L1Ssim(0.2), corrections)
        resume_and_train(state, *sets, Checkpoint(tmp_path / "none.zarr", "", 1e9))
        scene = TrainedScene(state.gaussians, SETTINGS, CAMERA, 0)
        if corrections is None:
            return mean_known(evaluate(scene, sets[1])[0])
        found = fitting.fit(scene, sets[1], corrections.values_at(sets[1].frame), corrections)
        return mean_known(evaluate(scene, applied(sets[1], found))[0])

    corrections = make_corrections(BOTH, start, sets[0], 0.1, 400)
    without, corrected_psnr = held_out(None), held_out(corrections)
    # A shift along the wall and a turn away from it look alike: the gains alone are determined.
    rest = corrections.values[:, 6] - error[sets[0].frame, 6]
    assert float((rest - rest.mean()).norm()) < 0.4 * float(error[sets[0].frame, 6].norm())
    assert corrected_psnr > without + 3.0


@pytest.mark.parametrize(
    "options, columns",
    [
        (OFF.change(refine_poses="on"), slice(0, 6)),
        (OFF.change(compensate_exposure="on"), slice(6, 9)),
        (BOTH, slice(0, 9)),
    ],
)
def test_each_key_changes_its_own_columns(start, pictures, camera_to_world, tmp_path, options, columns):
    sets = view_sets(pictures, camera_to_world)
    assert make_corrections(OFF, start, sets[0], 0.1, 60) is None
    corrections = make_corrections(options, start, sets[0], 0.1, 60)
    state = TrainingState(start, OPTIONS, 1.0, L1Ssim(0.2), corrections)
    resume_and_train(state, *sets, Checkpoint(tmp_path / "none.zarr", "", 1e9))
    changed = corrections.values.abs().amax(dim=0) > 0
    expected = torch.zeros(COLUMNS, dtype=torch.bool)
    expected[columns] = True
    assert torch.equal(changed, expected)
    np.testing.assert_allclose(corrections.values.mean(dim=0).numpy(), 0.0, atol=1e-12)


def test_a_resumed_run_has_the_same_corrections(start, pictures, camera_to_world, tmp_path):
    sets = view_sets(pictures, camera_to_world)
    options = replace(OPTIONS, evaluate_every=20)

    def run(checkpoint: Checkpoint) -> TrainingState:
        corrections = make_corrections(BOTH, start, sets[0], 0.1, 60)
        copy = start.select(torch.arange(start.count))
        state = TrainingState(copy, options, 1.0, L1Ssim(0.2), corrections)
        resume_and_train(state, *sets, checkpoint)
        return state

    unbroken = run(Checkpoint(tmp_path / "none.zarr", "", 1e9))
    with pytest.raises(Stopped):
        run(StoppingCheckpoint(tmp_path / "splats.zarr", "key", at=30))
    resumed = run(Checkpoint(tmp_path / "splats.zarr", "key", 1e9))
    assert torch.equal(resumed.gaussians.means, unbroken.gaussians.means)
    for name, tensor in unbroken.corrections.state_dict().items():
        assert torch.equal(resumed.corrections.state_dict()[name], tensor), name
    assert bool((unbroken.corrections.steps > 0).all())


def test_highlights_gain_less(start, camera_to_world, pictures):
    ramp = torch.linspace(0.05, 1.0, 64).reshape(8, 8, 1).expand(8, 8, 3)
    truth = torch.tensor([0.4])
    gains = torch.tensor([0.3, -0.3])[:, None].expand(2, 3)
    photographs = [expose(ramp, gain, truth) for gain in gains]
    torch.testing.assert_close(photographs[0][-1, -1], torch.full((3,), math.exp(0.3 * 1.1 / 1.4)))
    views = views_of(pictures, camera_to_world, 0, 1)
    corrections = make_corrections(OFF.change(compensate_exposure="on"), start, views, 0.1, 1500)
    order = np.random.default_rng(0).integers(2, size=1500)
    for iteration, index in enumerate(order.tolist()):
        corrections.camera_to_world(index)
        nothing_saturated = torch.zeros_like(ramp)
        error = corrections.exposed(ramp, nothing_saturated) - photographs[index]
        error.square().mean().backward()
        corrections.step(index, iteration)
    assert float(corrections.compression) == pytest.approx(0.4, abs=0.15)
    np.testing.assert_allclose(corrections.values[:, 6:].numpy(), gains.numpy(), atol=0.02)


def test_a_saturated_color_asks_for_no_less_light():
    picture = torch.tensor([1.0, 0.99, 0.5]).expand(2, 2, 3)
    for value, expected in ((0.4, [0.8, 0.8, 0.8]), (0.8, [1.0, 0.99, 1.6])):
        image = torch.full((2, 2, 5), value, requires_grad=True)
        found = expose(image, torch.full((3,), math.log(2.0)), None, picture)
        torch.testing.assert_close(found[..., :3], torch.tensor(expected).expand(2, 2, 3))
        assert torch.equal(found[..., 3:], image[..., 3:])
        (gradient,) = torch.autograd.grad(found[..., :3].sum(), image)
        assert torch.equal(gradient[..., 0] > 0, torch.full((2, 2), value < 0.5)) and bool(
            (gradient[..., 2] > 0).all()
        )


def _exposed_step_by_step(image, log_gain, compression, picture):
    colors = image[..., :3]
    curve = (1.0 + compression / 4) / (1.0 + compression * colors.clamp_max(10.0) ** 2)
    colors = colors * torch.exp(log_gain * curve)
    colors = colors - torch.where(picture >= 0.98, (colors - picture).clamp_min(0.0), 0.0)
    return torch.cat([colors, image[..., 3:]], dim=-1)


@pytest.mark.parametrize("features, dtype", [(0, torch.float64), (2, torch.float64), (0, torch.float32)])
def test_gradients_of_the_exposure_are_those_of_its_formula(features, dtype):
    """Also where a color is exactly as bright as a limit, and by the kernel, which takes float32."""
    generator = torch.Generator().manual_seed(0)
    picture = torch.rand(6, 5, 3, generator=generator, dtype=torch.float64)
    picture[1:3], picture[3] = 1.0, 0.99
    image = 2.0 * torch.rand(6, 5, 3 + features, generator=generator, dtype=torch.float64)
    image[0, 0], image[1, 0], image[0, 1], image[0, 2], image[1, 2] = 12.0, 40.0, 0.0, 9.99, 1.0
    weights = torch.rand(image.shape, generator=generator, dtype=torch.float64)
    values = image, torch.tensor([0.0, -0.3, 0.1]).double(), torch.tensor([0.7]).double()
    results = []
    for function in (expose, _exposed_step_by_step):
        leaves = [value.to(dtype, copy=True).requires_grad_() for value in values]
        found = function(*leaves, picture.to(dtype))
        results.append([found, *torch.autograd.grad((weights.to(dtype) * found).sum(), leaves)])
    torch.testing.assert_close(*results)


def test_gains_are_measured_where_nothing_is_saturated(start, camera_to_world, pictures):
    views = view_sets(pictures, camera_to_world)[0]
    none, picture = torch.zeros(COLUMNS, dtype=torch.float64), views.picture(0)
    assert torch.equal(fitting.with_best_gain(none, picture, torch.ones_like(picture), None), none)


def test_corrections_are_interpolated_only_where_they_change_slowly(start, pictures, camera_to_world):
    known, views = np.array([0, 1, 2, 4, 5, 6, 7, 8]), views_of(pictures, camera_to_world, *range(8))
    corrections = make_corrections(BOTH, start, replace(views, frame=known), 0.1, 60)
    slow, fast = np.sin(known / 3.0)[:, None], np.where(known % 2, 1.0, -1.0)[:, None]
    corrections.steps += 1
    corrections.values[:, :1] = torch.from_numpy(slow)
    guess = corrections.values_at(np.array([3, 5, 9]))[:, 0]
    np.testing.assert_allclose(guess, [(slow[2, 0] + slow[3, 0]) / 2, slow[4, 0], slow[-1, 0]])
    corrections.values[:, :1] = torch.from_numpy(fast)
    assert corrections.values_at(np.array([3, 5]))[:, 0].tolist() == [0.0, 1.0]
    assert predicts(known, slow) and not predicts(known, fast) and not predicts(known[:2], slow[:2])


@pytest.mark.parametrize("found, expected", [(None, "off"), (False, "off"), (True, "on")])
def test_auto_follows_the_survey_that_is_given(monkeypatch, tmp_path, found, expected):
    document = {"camera": {"refine_poses": found, "compensate_exposure": not found}}
    monkeypatch.setattr("egosplat.gaussians.corrections.read_document", lambda path, _: document)
    options = CameraOptions(refine_poses="auto", compensate_exposure="off")
    done = resolve_camera(options, None if found is None else tmp_path / "survey.json")
    assert done == CameraOptions(refine_poses=expected, compensate_exposure="off")

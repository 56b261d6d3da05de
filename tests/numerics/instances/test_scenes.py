"""Whole scenes at the extremes: of any size, with Gaussians that are not finite, and with cameras that see nothing."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from egosplat.alarms.artifact_alarms import alarms_of
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import POSES
from egosplat.gaussians.render import RenderSettings
from egosplat.instances import geometry
from egosplat.instances.lifted_masks import lift
from egosplat.instances.rendering import render_things
from egosplat.instances.things import beliefs
from tests.support.scenes import sideways
from tests.support.splats import blobs
from tests.unit.instances.conftest import CAMERA, FRAMES, SIZE, camera_positions, options
from tests.unit.instances.test_stage import agreement
from tests.unit.instances.test_stage import run as merge


def run(folder, **changes):
    """The verified artifact, whose arrays are finite."""
    found = merge(folder, **changes)
    assert all(np.isfinite(found.read(name)).all() for name in found.schema.fields)
    return found


@pytest.mark.numerics(
    "scene of 4 mm to 4 km: share of wrong pixels", within=0.05, outside="near plane in proportion"
)
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_any_size(measured, scene, truth, scale):
    poses = open_artifact(scene() / "poses.zarr", POSES)
    camera_to_world, points = poses.read("camera_to_world"), poses.read("points/xyz") * scale
    camera_to_world[:, :3, 3] *= scale
    folder = scene(**{"camera_to_world": camera_to_world, "points/xyz": points})
    measured(1 - agreement(run(folder, near_plane=0.1 * scale), truth))


@pytest.mark.numerics("frame that looks away from the scene", outside="its pixels have no instance")
def test_a_camera_that_sees_nothing(scene):
    poses = sideways(camera_positions())
    poses[4] = np.diag([-1.0, 1.0, -1.0, 1.0])
    # It is no training frame: training would place Gaussians before it.
    labels = run(scene(camera_to_world=poses, train=np.arange(FRAMES) != 4)).read("labels")
    assert (labels[4] == -1).all() and (labels[3, 1] >= 0).mean() > 0.95


@pytest.mark.numerics(
    "half of the temporary Gaussians NaN or infinite: share of wrong pixels",
    within=0.05,
    outside="left out, never stored",
)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_trained_gaussians_that_are_not_finite(measured, scene, truth, monkeypatch, value):
    diverge(monkeypatch, slice(None, None, 2), value)
    measured(1 - agreement(run(scene()), truth))


@pytest.mark.numerics("all temporary Gaussians NaN", outside="no instance; alarm")
def test_no_finite_gaussian(scene, monkeypatch):
    diverge(monkeypatch, slice(None), np.nan)
    found = run(scene({"segmenter": "sam2"}))
    assert found.shape("gaussians/xyz") == (0, 3) and found.shape("instances/level") == (0,)
    assert (found.read("labels") == -1).all()
    assert "instances.empty_pixels" in [alarm.key for alarm in alarms_of(found)]


def diverge(monkeypatch, chosen, value):
    """Let some of the trained Gaussians have centers that are not finite."""
    finished = geometry.train_alone

    def diverged(state, *others):
        finished(state, *others)
        with torch.no_grad():
            state.gaussians.means[chosen] = value

    monkeypatch.setattr(geometry, "train_alone", diverged)


@pytest.mark.numerics(
    "lifting and rendering with NaN or infinite Gaussians", within=0.0, outside="as without them"
)
@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((name, np.nan) for name in ("means", "quats", "log_scales", "logit_opacities")),
        # An infinite logit is the opacity 1.
        *((name, np.inf) for name in ("means", "quats", "log_scales")),
    ],
)
def test_gaussians_that_are_not_finite(measured, name, value):
    means = np.random.default_rng(0).uniform([-1, -1, 1.9], [1, 1, 2.1], (400, 3)).tolist()
    some, labels = blobs(means, [0.73] * 400, size=0.08), np.zeros((1, SIZE, SIZE), np.int32)
    getattr(some, name)[::2] = value
    labels[:, :, SIZE // 2 :] = 1
    settings = RenderSettings(options().near_plane, "black", "cpu")
    views = SimpleNamespace(frame=np.zeros(1, np.int64), camera_to_world=np.eye(4)[None], camera=CAMERA)
    fewer, seen = some.select(torch.arange(400) % 2 == 1), np.ones((SIZE, SIZE), bool)
    segments = SimpleNamespace(row=lambda *_: labels)
    geometries = [SimpleNamespace(gaussians=each, views=views, settings=settings) for each in (some, fewer)]
    found, expected = (lift(one, segments, lambda _: seen, lambda own: (own, ~seen)) for one in geometries)
    assert not found.seen[:, ::2].nnz and not found.votes[::2].nnz
    measured(np.abs((found.seen[:, 1::2] - expected.seen).toarray()).max())
    shown, alone = (
        render_things(geometry_, [beliefs(masks, np.arange(2))], CAMERA, np.eye(4), settings, (SIZE, SIZE))
        for geometry_, masks in ((some, found), (fewer, expected))
    )
    assert np.array_equal(shown, alone) and set(np.unique(shown)) >= {0, 1}

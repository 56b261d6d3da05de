"""Two flat squares with known features: every method that trains answers them right from a place it has not seen."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.features import FEATURES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.instances import INSTANCES
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import open_artifact
from egosplat.codes.decoder import decode
from egosplat.codes.rendering import render_codes
from egosplat.codes.targets import CodeTargets
from egosplat.gaussians.initialization import from_points
from egosplat.gaussians.pixel_weights import Masking
from egosplat.language.methods import METHODS
from egosplat.language.options import LanguageOptions
from egosplat.language.views import select_code_views
from egosplat.pipeline.config import defaults
from tests.support.scenes import camera_facts, put, put_scene
from tests.unit.language.conftest import CAMERA, FRAME_COUNT, HELD_OUT, SIZE

CPU = torch.device("cpu")
NAMES = ["subpart", "part", "whole"]
FEATURE = np.eye(8, dtype=np.float32)[:2]

# Of each method, iterations that suffice for so small a scene.
ITERATIONS = {"sparse": 120, "granular": 150}


@pytest.fixture(scope="module")
def squares():
    """Opaque Gaussians on two squares 2 m ahead, with a gap between them."""
    side = np.linspace(-0.6, 0.6, 13)
    grid = np.stack(np.meshgrid(side, side, [2.0]), axis=-1).reshape(-1, 3)
    xyz = np.concatenate([grid + [-0.9, 0, 0], grid + [0.9, 0, 0]])
    gaussians = from_points(
        xyz, np.zeros((len(xyz), 3), np.uint8), sh_degree=0, feature_channels=0, max_points=1000, seed=0
    )
    gaussians.logit_opacities.fill_(4.0)
    return gaussians


def square_of(pose: np.ndarray, margin: float) -> np.ndarray:
    """(SIZE, SIZE) 0 on the left square, 1 on the right one, -1 outside or within ``margin`` of an edge [m]."""
    at = (np.arange(SIZE) + 0.5 - SIZE / 2) / CAMERA.fx * 2.0
    x, y = np.meshgrid(at + pose[0, 3], at + pose[1, 3])
    inside = (abs(abs(x) - 0.9) < 0.6 - margin) & (abs(y) < 0.6 - margin)
    return np.where(inside, (x > 0).astype(np.int32), -1)


@pytest.fixture
def scene(tmp_path, squares, settings, camera_to_world):
    """Gaussians, views, settings and targets of the squares; instance 2 l + s is square s at level l."""
    square = np.stack([square_of(pose, 0.0) for pose in camera_to_world])
    levels = 2 * np.arange(3)[None, :, None, None]
    labels = np.where(square[:, None] < 0, -1, square[:, None] + levels).astype(np.int32)
    views = np.array([(one, frame) for one in range(6) for frame in range(FRAME_COUNT)], np.int32)
    arrays = {
        "rgb": np.zeros((FRAME_COUNT, SIZE, SIZE, 3), np.uint8),
        "train": np.arange(FRAME_COUNT) != HELD_OUT,
        "camera_to_world": camera_to_world,
        "intrinsics": CAMERA.matrix,
    }
    put_scene(tmp_path, ["frames", "poses"], arrays, camera_facts(CAMERA))
    level = np.arange(6, dtype=np.int8) // 2
    put(tmp_path, "instances", {"labels": labels, "instances/level": level}, {"levels": NAMES})
    features = {
        "consistent": FEATURE[np.arange(6) % 2],
        "views": np.ones(6, np.int32),
        "instances/level": level,
        "instance": views[:, 0],
        "frame": views[:, 1],
        "supervision": FEATURE[views[:, 0] % 2],
        "code": FEATURE[views[:, 0] % 2],
        "consistent_code": FEATURE[np.arange(6) % 2],
    }
    put(
        tmp_path,
        "features",
        features,
        {"levels": NAMES, "decoder": {"widths": [8]}},
        options={"supervision": "view"},
        made_from=["instances"],
    )
    kinds = {"frames": FRAMES, "poses": POSES, "instances": INSTANCES, "features": FEATURES}
    frames, poses, instances, found = (
        open_artifact(tmp_path / f"{name}.zarr", schema) for name, schema in kinds.items()
    )
    targets = CodeTargets(instances, found, CPU)
    return squares, select_code_views(frames, poses, targets.of, Masking(None, ""), CPU), settings, targets


def options_of(method: str, **changes: object) -> LanguageOptions:
    keys = defaults()["language"] | {
        "method": method,
        "iterations": ITERATIONS[method],
        "pixels": 200,
        "lr": 0.02,
    }
    return LanguageOptions(**keys | changes)


@pytest.mark.parametrize("method", [*ITERATIONS])
def test_each_square_is_answered_with_its_feature(scene, camera_to_world, tmp_path, method):
    checkpoint = Checkpoint(tmp_path / "language.zarr", "key", 1e9)
    coded = METHODS[method](*scene, options_of(method), checkpoint)
    gaussians, views, settings, _ = scene
    pose = camera_to_world[HELD_OUT]
    found = render_codes(gaussians, coded.code, coded.share, views.camera, pose, settings)
    square = square_of(pose, 0.15)
    for level in range(len(coded.levels)):
        for side in (0, 1):
            pixels = torch.from_numpy(square == side)
            assert bool((found.coverage[level][pixels] > 0.5).all())
            cosine = decode(found.codes[level][pixels], coded.decoder) @ torch.from_numpy(FEATURE.T)
            assert float(cosine[:, side].min()) > 0.9, coded.levels[level]
            assert float(cosine[:, 1 - side].max()) < 0.3
    assert coded.curve.loss[-1] < coded.curve.loss[0] and len(coded.stands_in) >= 2


@pytest.mark.parametrize("method", [*ITERATIONS])
def test_a_killed_training_goes_on_to_the_same_result(scene, tmp_path, method, monkeypatch):
    def run(folder: str, iterations: int = 40):
        checkpoint = Checkpoint(tmp_path / folder / "language.zarr", "key", 0.0)
        checkpoint.file.parent.parent.mkdir(exist_ok=True)
        return METHODS[method](*scene, options_of(method, iterations=iterations), checkpoint)

    whole = run("whole")
    from egosplat.language import loop

    record = loop.Training._record

    def killed(self) -> None:
        record(self)
        if self.iteration == 30:
            raise KeyboardInterrupt

    monkeypatch.setattr(loop.Training, "_record", killed)
    with pytest.raises(KeyboardInterrupt):
        run("killed")
    monkeypatch.setattr(loop.Training, "_record", record)
    rest = run("killed")
    assert torch.equal(whole.code, rest.code) and whole.curve == rest.curve
    assert np.array_equal(whole.decoder.values, rest.decoder.values)
    assert replace(whole.decoder, values=rest.decoder.values).widths == rest.decoder.widths

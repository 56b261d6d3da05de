"""A wall of Gaussians, its left half one instance and its right half another, as artifacts and in memory."""

from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import torch

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FEATURES, FRAMES, INSTANCES, POSES, SPLATS
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.training_views import Masking, open_masking
from egosplat.language.targets import CodeTargets
from egosplat.language.views import select_code_views
from tests.support.gaussian_scene import CAMERA, SETTINGS, SIZE, opaque, photographs
from tests.support.scenes import LEVELS, camera_facts, put, sideways

LINEAR = {"compression": "linear", "dims": "auto"}
FRAME_COUNT = 5
HELD_OUT = 2
NEEDS_SKLEARN = pytest.mark.skipif(not find_spec("sklearn"), reason="scikit-learn is absent")
CLUSTERED = pytest.param("clustered", marks=NEEDS_SKLEARN)
CODES = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, -0.5], [0.3, 0.3, 0.3]], np.float32)
"""Of the instances: 0 is the left half and 1 the right half, both at level 1; 2 is the middle, at level 0."""


@pytest.fixture(scope="session")
def wall() -> Gaussians:
    """Opaque Gaussians on a plane 2 m ahead."""
    grid = np.stack(np.meshgrid(np.linspace(-1.6, 1.6, 16), np.linspace(-1.6, 1.6, 16), [2.0]), axis=-1)
    xyz = grid.reshape(-1, 3)
    return opaque(xyz, np.random.default_rng(0).integers(256, size=(len(xyz), 3), dtype=np.uint8))


@pytest.fixture(scope="session")
def camera_to_world() -> np.ndarray:
    """(5, 4, 4) a small step to the right for each frame, looking ahead."""
    return sideways(np.linspace(-0.2, 0.2, FRAME_COUNT))


@pytest.fixture(scope="session")
def labels(camera_to_world) -> np.ndarray:
    """(5, 2, 24, 24) instances."""
    found = np.full((FRAME_COUNT, 2, SIZE, SIZE), -1, np.int32)
    columns = np.arange(SIZE) + 0.5
    for frame, pose in enumerate(camera_to_world):
        x = (columns - CAMERA.cx) / CAMERA.fx * 2.0 + pose[0, 3]
        found[frame, 1] = np.where(x < 0, 0, 1)
        found[frame, 0, 8:16] = np.where(np.abs(x) < 0.5, 2, -1)
    return found


def feature_arrays(codes: np.ndarray, level: np.ndarray, views: np.ndarray) -> dict[str, np.ndarray]:
    """Arrays of features.zarr: (I, C) codes and (I,) levels of instances, each with the same code in its (instance, frame) views."""
    instance, frame = views.T
    own = {"instance": instance, "frame": frame, "supervision": codes[instance], "code": codes[instance]}
    consistent = {"consistent": codes, "consistent_code": codes, "views": np.ones(len(codes), np.int32)}
    return own | consistent | {"instances/level": level}


@pytest.fixture
def scene(tmp_path, wall, camera_to_world, labels) -> Callable[..., Path]:
    """``scene(target=, rows=, levels=)``: a folder with all that the stage reads but the splats. ``target`` is features.supervision;
    ``rows`` are (instance, frame) of the views that were encoded, by default all; ``levels`` are of the instances."""

    def make(
        target: str = "average", rows: list[tuple[int, int]] | None = None, levels: Sequence[int] = (1, 1, 0)
    ) -> Path:
        facts = camera_facts(CAMERA)
        frames = {"rgb": photographs(wall, camera_to_world), "train": np.arange(FRAME_COUNT) != HELD_OUT}
        poses = {
            "camera_to_world": camera_to_world,
            "intrinsics": CAMERA.matrix,
            "points/xyz": wall.means.double().numpy(),
            "points/rgb": np.full((wall.count, 3), 128, np.uint8),
        }
        level = np.array(levels, np.int8)
        views = np.argwhere(np.ones((3, FRAME_COUNT))) if rows is None else np.array(rows)
        views = views.astype(np.int32)
        moving = np.zeros((FRAME_COUNT, SIZE, SIZE), bool)
        moving[:, :, :4] = True
        put(tmp_path, "frames", frames, facts)
        put(tmp_path, "poses", poses, facts, made_from=["frames"])
        about = {"levels": LEVELS, "decoder": {"widths": [3]}}
        put(tmp_path, "instances", {"labels": labels, "instances/level": level}, about, made_from=["frames"])
        options = LINEAR | {"supervision": target}
        put(tmp_path, "features", feature_arrays(CODES, level, views), about, options=options)
        still = np.zeros(3, bool)
        put(tmp_path, "masks", {"refined": moving, "instances/transient": still}, made_from=["instances"])
        put(tmp_path, "transient", {"probability": moving.astype(np.float16) / 2}, made_from=["frames"])
        return tmp_path

    return make


@pytest.fixture(scope="session")
def unrefined(tmp_path_factory) -> Artifact:
    """Splats that render with the poses of poses.zarr."""
    return open_artifact(put(tmp_path_factory.mktemp("unrefined"), "splats"), SPLATS)


@pytest.fixture
def checkpoint(tmp_path) -> Checkpoint:
    """One that is not due."""
    return Checkpoint(tmp_path / "language.zarr", "key", 1e9)


def open_features(folder: Path) -> list[Artifact]:
    """The frames, poses, instances and features of a folder."""
    kinds = {"frames": FRAMES, "poses": POSES, "instances": INSTANCES, "features": FEATURES}
    return [open_artifact(folder / f"{name}.zarr", schema) for name, schema in kinds.items()]


@pytest.fixture
def prepared(scene, unrefined, wall):
    """``prepared(masked, gaussians, **changes)``: the training views of a scene, by default of the wall, and its targets."""

    def make(masked: bool = False, gaussians: Gaussians = wall, **changes: object):
        folder = scene(**changes)
        frames, poses, instances, features = open_features(folder)
        targets = CodeTargets(instances, features, torch.device("cpu"))
        masking = Masking(None, "")
        if masked:
            masking = open_masking("refined", frames, {"masks_path": folder / "masks.zarr"})
        return select_code_views(frames, poses, unrefined, targets.of, masking, gaussians, SETTINGS), targets

    return make

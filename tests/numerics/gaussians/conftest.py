"""A small scene with pictures of known Gaussians, as artifacts."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from egosplat import files
from egosplat.artifacts import provenance
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.provenance import begin
from egosplat.artifacts.reader import Artifact, recorded_digest, verify
from egosplat.artifacts.registry import SCHEMAS
from egosplat.artifacts.transient import TRANSIENT
from egosplat.artifacts.writer import create
from egosplat.geometry import Camera
from egosplat.pipeline.config import defaults
from egosplat.splats import stage

SIZE, FRAME_COUNT = 20, 7
CAMERA = Camera(SIZE, SIZE, 18.0, 18.0, SIZE / 2, SIZE / 2)
KEYS = defaults()["splats"] | {
    "masking": "none",
    "iterations": 40,
    "max_points": 60,
    "cover": False,
    "max_gaussians": 80,
    "evaluate_every": 20,
    "sh_degree": 1,
}
NOTHING = dict.fromkeys(("transient", "masks", "segments", "features"))


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither hash the code of the stage nor wait for the disk, which here takes longer than all else."""
    monkeypatch.setattr(provenance, "code_of", lambda stage: "0")
    monkeypatch.setattr(files, "_sync_one", lambda path: None)


@pytest.fixture
def scene(tmp_path: Path) -> Callable[..., Path]:
    """``scene(**changes)``: a folder with frames.zarr and poses.zarr of a checked wall; changes replace arrays.

    With ``probability`` among them there is a transient.zarr too.
    """

    def make(**changes: np.ndarray) -> Path:
        rng = np.random.default_rng(0)
        poses = np.tile(np.eye(4), (FRAME_COUNT, 1, 1))
        poses[:, 0, 3] = np.linspace(-0.4, 0.4, FRAME_COUNT)
        checks = (np.indices((SIZE, SIZE)) // 5).sum(axis=0) % 2
        held_out = np.arange(FRAME_COUNT) == 3
        arrays = {
            "rgb": np.tile(
                (checks[..., None] * [200, 120, 40] + 30).astype(np.uint8), (FRAME_COUNT, 1, 1, 1)
            ),
            "valid": np.ones((SIZE, SIZE), bool),
            "timestamp_ns": np.arange(FRAME_COUNT) * 100_000_000,
            "exposure_middle_ns": np.arange(FRAME_COUNT) * 100_000_000,
            "train": ~held_out,
            "evaluation": held_out,
            "camera_to_world": poses,
            "registered": np.ones(FRAME_COUNT, bool),
            "intrinsics": CAMERA.matrix,
            "up": np.array([0.0, -1.0, 0.0]),
            "points/xyz": rng.uniform([-1.2, -1.2, 1.9], [1.2, 1.2, 2.1], (40, 3)),
            "points/rgb": rng.integers(256, size=(40, 3), dtype=np.uint8),
            "weights": np.zeros(1, np.float32),
            "curve/iteration": np.ones(1, np.int64),
            "curve/loss": np.zeros(1),
            "curve/probability": np.zeros(1),
        } | changes
        inputs: dict[str, str] = {}
        facts: dict[str, Any] = {
            "recording": "",
            "camera": asdict(CAMERA),
            "notes": {},
            "format": "plain",
            "upright": True,
        }
        for schema in (FRAMES, POSES, *([TRANSIENT] if "probability" in changes else [])):
            path = tmp_path / f"{schema.name}.zarr"
            with create(path, schema, begin("frames", {}, "synthetic", inputs)) as artifact:
                for name in schema.fields:
                    artifact.put(name, arrays[name])
                artifact.facts = facts
            if schema is FRAMES:
                inputs = {"frames.zarr": recorded_digest(path)}
        return tmp_path

    return make


@pytest.fixture
def run() -> Callable[..., Artifact]:
    """``run(folder, **changes)``: the verified splats artifact, all numbers of which are finite."""

    def call(folder: Path, **changes: object) -> Artifact:
        keys, output = KEYS | changes, folder / "splats.zarr"
        inputs = NOTHING | {"transient": folder / "transient.zarr"}
        stage.run(folder / "frames.zarr", folder / "poses.zarr", output, **inputs, **keys)
        made = verify(output, SCHEMAS)
        for name in ("means", "quats", "log_scales", "logit_opacities", "sh"):
            assert np.isfinite(made.read(name)).all(), name
        assert made.shape("means")[0] > 0
        return made

    return call


@pytest.fixture
def left() -> Callable[[Path], bool]:
    """``left(folder)``: whether a splats artifact, a checkpoint, or a part of one lies in the folder."""
    return lambda folder: any("splats" in path.name for path in folder.iterdir())

"""A small scene with images of known Gaussians, as artifacts."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from egosplat.artifacts.reader import Artifact, verify
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.geometry import Camera
from egosplat.pipeline.config import defaults
from egosplat.splats import stage
from tests.support.scenes import camera_facts, put, put_scene, sideways

SIZE, FRAME_COUNT = 20, 7
CAMERA = Camera(SIZE, SIZE, 18.0, 18.0, SIZE / 2, SIZE / 2)
KEYS = (
    defaults()["camera"]
    | defaults()["splats"]
    | {
        "masking": "none",
        "iterations": 40,
        "max_points": 60,
        "max_gaussians": 80,
        "evaluate_every": 20,
        "sh_degree": 1,
    }
)


@pytest.fixture
def scene(tmp_path: Path) -> Callable[..., Path]:
    """``scene(**changes)``: a folder with frames.zarr and poses.zarr of a checked wall; changes replace
    arrays, or add ``facts``. With ``probability`` among them there is a transient.zarr too."""

    def make(**changes: Any) -> Path:
        rng = np.random.default_rng(0)
        checks = (np.indices((SIZE, SIZE)) // 5).sum(axis=0) % 2
        arrays = {
            "rgb": np.tile(
                (checks[..., None] * [200, 120, 40] + 30).astype(np.uint8), (FRAME_COUNT, 1, 1, 1)
            ),
            "train": np.arange(FRAME_COUNT) != 3,
            "camera_to_world": sideways(np.linspace(-0.4, 0.4, FRAME_COUNT)),
            "intrinsics": CAMERA.matrix,
            "points/xyz": rng.uniform([-1.2, -1.2, 1.9], [1.2, 1.2, 2.1], (40, 3)),
            "points/rgb": rng.integers(256, size=(40, 3), dtype=np.uint8),
        } | changes
        facts = camera_facts(CAMERA) | arrays.pop("facts", {})
        probability = arrays.pop("probability", None)
        put_scene(tmp_path, ["frames", "poses"], arrays, facts, chained=True)
        if probability is not None:
            put(tmp_path, "transient", {"probability": probability}, facts, made_from=["frames"])
        return tmp_path

    return make


@pytest.fixture
def run() -> Callable[..., Artifact]:
    """``run(folder, **changes)``: the verified splats artifact, all numbers of which are finite."""

    def call(folder: Path, **changes: object) -> Artifact:
        options, output = stage.SplatsOptions(**KEYS | changes), folder / "splats.zarr"
        paths = folder / "frames.zarr", folder / "poses.zarr", output
        stage.run(*paths, options, transient_path=folder / "transient.zarr")
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

"""A tiny OpenCLIP with random weights, and a small scene with instances, as artifacts."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.scenes import LEVELS, put
from tests.support.tiny_clip import CHECKPOINT

SIZE = 40
FRAME_COUNT = 5


@pytest.fixture
def clip_keys(tiny_clip: Path) -> dict[str, str]:
    """The keys of the section ``models`` for it."""
    files = {"clip_model": str(tiny_clip), "clip_checkpoint": str(tiny_clip / CHECKPOINT)}
    return files | {"device": "cpu", "precision": "float32"}


@pytest.fixture
def labels() -> np.ndarray:
    """(5, 2, 40, 40) int32: instances 0 (moving) and 1 (large) of level 0, 2 of level 1, 3 of one pixel, 4 nowhere."""
    labels = np.full((FRAME_COUNT, 2, SIZE, SIZE), -1, np.int32)
    for frame in range(FRAME_COUNT):
        labels[frame, 0, 2:9, 3 * frame : 3 * frame + 11] = 0
        labels[frame, 0, 20:38, 5:30] = 1
    labels[2, 1, 10:14, 10:16] = 2
    labels[3, 1, 5, 5] = 3
    return labels


@pytest.fixture
def scene(tmp_path: Path, labels: np.ndarray) -> Callable[..., Path]:
    """``scene(labels=, train=, level=, **facts)``: a folder with frames.zarr and instances.zarr."""

    def make(
        labels: np.ndarray = labels,
        train: np.ndarray | None = None,
        level: tuple[int, ...] = (0, 0, 1, 1, 0),
        **facts: Any,
    ) -> Path:
        frames, _, height, width = labels.shape
        rng = np.random.default_rng(0)
        train = np.arange(frames) != 4 if train is None else train
        rgb = rng.integers(256, size=(frames, height, width, 3), dtype=np.uint8)
        about = {"recording": "a recording", "format": "adt", "upright": True} | facts
        put(tmp_path, "frames", {"rgb": rgb, "train": train}, about)
        instances = {"labels": labels, "instances/level": np.array(level, np.int8)}
        put(tmp_path, "instances", instances, {"levels": LEVELS}, made_from=["frames"], stage="frames")
        return tmp_path

    return make


def put_views(folder: Path, feature: np.ndarray, instance: Sequence[int], level: Sequence[int]) -> Path:
    """The path of a view_features.zarr of these rows."""
    arrays = {
        "feature": np.asarray(feature, np.float32),
        "instance": np.asarray(instance, np.int32),
        "frame": np.arange(len(instance), dtype=np.int32),
        "instances/level": np.asarray(level, np.int8),
    }
    facts = {"levels": LEVELS, "clip": {"small": True, "hash": "0"}}
    return put(folder, "view_features", arrays, facts, stage="frames")

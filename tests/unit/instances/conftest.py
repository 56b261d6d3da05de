"""A wall of two squares, filmed by a camera that moves along it, and masks made by hand."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse

from egosplat.geometry import Camera
from egosplat.instances.lifted_masks import LiftedMasks
from egosplat.instances.options import InstancesOptions
from tests.support.scenes import camera_facts, put_scene, sideways

SIZE, FRAMES, DISTANCE = 48, 10, 2.0
CAMERA = Camera(SIZE, SIZE, 40.0, 40.0, SIZE / 2, SIZE / 2)
LEFT, RIGHT = 0, 1
COLORS = np.array([[200, 40, 40], [40, 40, 200]], np.uint8)


def options(**changes: object) -> InstancesOptions:
    """The defaults with the source masks, for a short time."""
    return InstancesOptions(**{"source": "masks", "iterations": 20, "resolution": SIZE} | changes)


def lifted(held: list[list[int]], frames: list[int], seen: list[list[int]], instance=None) -> LiftedMasks:
    """Masks that hold Gaussians completely, in frames that see Gaussians with a weight of 1 px each."""
    count = 1 + max(max(one) for one in seen)
    votes = np.zeros((count, len(held)), np.float32)
    for mask, members in enumerate(held):
        votes[members, mask] = 1.0
    weight = np.zeros((len(seen), count), np.float32)
    for frame, members in enumerate(seen):
        weight[frame, members] = 1.0
    names = np.arange(len(held)) if instance is None else np.array(instance)
    frame, rows = np.array(frames, np.int64), np.arange(len(seen))
    return LiftedMasks(names, frame, rows, sparse.csc_array(votes), sparse.csr_array(weight))


def truth_of_wall() -> np.ndarray:
    """(F, H, W) square of each pixel of the wall: the left or the right one."""
    column = np.arange(SIZE) + 0.5
    found = np.empty((FRAMES, SIZE, SIZE), np.int32)
    for frame, shift in enumerate(camera_positions()):
        x = (column - CAMERA.cx) / CAMERA.fx * DISTANCE + shift
        found[frame] = np.where(x < 0, LEFT, RIGHT)
    return found


def camera_positions() -> np.ndarray:
    """(F,) position of the camera along the wall [m]."""
    return np.linspace(-0.5, 0.5, FRAMES)


def marked(truth: np.ndarray) -> np.ndarray:
    """(F, 2, H, W) labels of the wall's masks in every second frame, each an instance of its own."""
    labels = np.full((FRAMES, 2, SIZE, SIZE), -1, np.int32)
    for frame in range(0, FRAMES, 2):
        labels[frame, 1] = truth[frame] + frame
    return labels


def masks_of_wall(folder: Path, facts: dict[str, object] | None = None, **changes: np.ndarray) -> Path:
    """Put frames, poses and segments; each mask of every second frame is an instance of its own."""
    truth = truth_of_wall()
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-2, 2, 800), rng.uniform(-1.5, 1.5, 800), np.full(800, DISTANCE)])
    arrays = {
        "rgb": COLORS[truth],
        "train": np.arange(FRAMES) != 5,
        "camera_to_world": sideways(camera_positions()),
        "intrinsics": CAMERA.matrix,
        "points/xyz": points,
        "points/rgb": COLORS[(points[:, 0] > 0).astype(int)],
        "labels": marked(truth),
        "instances/level": np.ones(FRAMES, np.int8),
    }
    about = camera_facts(CAMERA, levels=["part", "whole"]) | (facts or {})
    put_scene(folder, ["frames", "poses", "segments"], arrays | changes, about, chained=True)
    return folder


@pytest.fixture
def truth() -> np.ndarray:
    """``truth_of_wall``."""
    return truth_of_wall()


@pytest.fixture
def scene(tmp_path) -> Callable[..., Path]:
    """``scene(**changes)``: ``masks_of_wall`` in the test's folder."""
    return partial(masks_of_wall, tmp_path)

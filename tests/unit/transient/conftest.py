"""A small scene with a square moving in front of a wall, as artifacts and as views."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from egosplat.gaussians.training_views import Views
from egosplat.geometry import Camera
from egosplat.transient.network import make_network
from egosplat.transient.objective import InitialObjective
from egosplat.transient.options import TransientOptions
from tests.support.scenes import camera_facts, put_scene, sideways

SIZE = 32
FRAME_COUNT = 6
CAMERA = Camera(SIZE, SIZE, 30.0, 30.0, SIZE / 2, SIZE / 2)


@pytest.fixture
def pictures() -> np.ndarray:
    """(6, 32, 32, 3) uint8: grey, and a white square in another place each time."""
    rgb = np.full((FRAME_COUNT, SIZE, SIZE, 3), 90, np.uint8)
    for frame in range(FRAME_COUNT):
        rgb[frame, 8:16, 4 * frame : 4 * frame + 8] = 255
    return rgb


@pytest.fixture
def views(pictures) -> Views:
    """All pictures, each of the same camera."""
    poses = np.tile(np.eye(4), (FRAME_COUNT, 1, 1))
    frames = np.arange(FRAME_COUNT)
    return Views(frames, torch.from_numpy(pictures), poses, None, None, CAMERA, torch.device("cpu"))


OPTIONS = TransientOptions(iterations=12, warmup=0, transient_penalty=0.15, recipe="paper", lr=3e-3)


def make_objective(**changes: object) -> InitialObjective:
    return InitialObjective(make_network(64, False, None, 0), OPTIONS.change(**changes), torch.device("cpu"))


def take_steps(objective: InitialObjective, views: Views, count: int, offset: float = 0.3) -> list[float]:
    """The losses of ``count`` steps against renders that are ``offset`` off."""
    losses = []
    for number in range(count):
        image = (views.picture(number % len(views)) + offset).requires_grad_()
        loss = objective.loss(image, views, number % len(views))
        loss.backward()
        objective.step()
        losses.append(loss.item())
    return losses


@pytest.fixture
def scene(tmp_path, pictures) -> Callable[..., Path]:
    """``scene(**changes)``: a folder with frames.zarr, poses.zarr and instances.zarr; changes replace arrays.
    Of the segments' three instances 0 is the square and 1 the lower half, both at level 2; 2 has no pixel."""

    def make(facts: dict[str, object] | None = None, **changes: np.ndarray) -> Path:
        rng = np.random.default_rng(0)
        labels = np.full((FRAME_COUNT, 3, SIZE, SIZE), -1, np.int32)
        labels[:, 2, SIZE // 2 :] = 1
        labels[:, 2][(pictures == 255).all(axis=-1)] = 0
        arrays = {
            "rgb": pictures,
            "train": np.arange(FRAME_COUNT) != 3,
            "camera_to_world": sideways(np.linspace(-0.1, 0.1, FRAME_COUNT)),
            "intrinsics": CAMERA.matrix,
            "points/xyz": rng.uniform([-1.0, -1.0, 1.9], [1.0, 1.0, 2.1], (60, 3)),
            "points/rgb": np.full((60, 3), 90, np.uint8),
            "labels": labels,
            "instances/level": np.array([2, 2, 1], np.int8),
        }
        about = camera_facts(CAMERA, levels=["subpart", "part", "whole"], source="tracks") | (facts or {})
        put_scene(tmp_path, ["frames", "poses", "instances"], arrays | changes, about)
        return tmp_path

    return make

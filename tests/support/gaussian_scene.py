"""A small scene with pictures of known Gaussians, as artifacts and as views."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.gaussians.initialization import from_points
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.optimizer import Adam, LearningRates
from egosplat.gaussians.render import RenderSettings, render
from egosplat.gaussians.training_views import Views
from egosplat.geometry import Camera
from tests.support.scenes import camera_facts, put_scene, sideways

SIZE = 24
FRAME_COUNT = 9
HELD_OUT = 4
CAMERA = Camera(SIZE, SIZE, 22.0, 22.0, SIZE / 2, SIZE / 2)
SETTINGS = RenderSettings(near_plane=0.1, background="black", backend="auto")


def opaque(xyz: np.ndarray, rgb: np.ndarray, *, logit: float = 4.0, sh_degree: int = 0) -> Gaussians:
    """Gaussians at up to 1000 points whose opacities have this logit."""
    gaussians = from_points(xyz, rgb, sh_degree=sh_degree, max_points=1000, seed=0)
    gaussians.logit_opacities.fill_(logit)
    return gaussians


@pytest.fixture(scope="session")
def points() -> tuple[np.ndarray, np.ndarray]:
    """(40, 3) points of a wavy wall 2 m in front of the cameras, and their colors."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform([-1.5, -1.5, 1.8], [1.5, 1.5, 2.2], (40, 3))
    return xyz, rng.integers(256, size=(40, 3), dtype=np.uint8)


@pytest.fixture(scope="session")
def truth(points) -> Gaussians:
    """The Gaussians in the pictures: opaque, at ``points``."""
    return opaque(*points, logit=3.0)


@pytest.fixture(scope="session")
def camera_to_world() -> np.ndarray:
    """(9, 4, 4) a step to the right for each frame, looking ahead."""
    return sideways(np.linspace(-0.4, 0.4, FRAME_COUNT))


def photographs(gaussians: Gaussians, camera_to_world: np.ndarray, camera: Camera = CAMERA) -> np.ndarray:
    """(N, H, W, 3) uint8 pictures of Gaussians."""
    options = {"sh_degree": gaussians.sh_degree, "background": None}
    images = [render(gaussians, camera, pose, SETTINGS, **options)[0] for pose in camera_to_world]
    return (torch.stack(images).clamp(0, 1) * 255).round().to(torch.uint8).numpy()


@pytest.fixture(scope="session")
def pictures(truth, camera_to_world) -> np.ndarray:
    """(9, 24, 24, 3) uint8."""
    return photographs(truth, camera_to_world)


@pytest.fixture
def scene(tmp_path, points, camera_to_world, pictures) -> Callable[..., Path]:
    """``scene(**changes)``: a folder with frames.zarr and poses.zarr; changes replace arrays."""

    def make(**changes: np.ndarray) -> Path:
        arrays = {
            "rgb": pictures,
            "train": np.arange(FRAME_COUNT) != HELD_OUT,
            "camera_to_world": camera_to_world,
            "intrinsics": CAMERA.matrix,
            "points/xyz": points[0],
            "points/rgb": points[1],
        }
        put_scene(tmp_path, ["frames", "poses"], arrays | changes, camera_facts(CAMERA))
        return tmp_path

    return make


def views_of(pictures: np.ndarray, poses: np.ndarray, *rows: int) -> Views:
    """Views of some frames, in memory."""
    frame = np.array(rows, np.int64)
    some = torch.from_numpy(pictures[frame])
    return Views(frame, some, poses[frame], None, None, CAMERA, torch.device("cpu"))


def with_moments(gaussians: Gaussians) -> Adam:
    """An optimizer whose moments are nonzero everywhere, while the Gaussians are as before."""
    before = {name: p.detach().clone() for name, p in gaussians.parameters().items()}
    optimizer = Adam(gaussians, LearningRates(means=1e-4))
    for parameter in gaussians.parameters().values():
        parameter.grad = torch.ones_like(parameter)
    optimizer.step(None)
    optimizer.zero_grad()
    for name, parameter in gaussians.parameters().items():
        parameter.detach().copy_(before[name])
    return optimizer


class Stopped(Exception):
    pass


class StoppingCheckpoint(Checkpoint):
    """Ends training as a kill would, right after the checkpoint of one iteration."""

    def __init__(self, output: Path, key: str, at: int) -> None:
        super().__init__(output, key, 1e-9)
        self.at = at

    def save_if_due(self, state) -> None:
        super().save_if_due(state)
        if state()["iteration"] == self.at:
            raise Stopped

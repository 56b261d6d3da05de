"""Pictures of a wall and a board before it, from anywhere, with a thing that may move; and as artifacts."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egosplat.geometry import Camera, make_pose
from tests.support.scenes import camera_facts, put_scene

SIZE = 160
CAMERA = Camera(SIZE, SIZE, 120.0, 120.0, SIZE / 2, SIZE / 2)
WALL, BOARD, THING = 4.0, 2.0, 1.5
"""Depths [m]; the board has 0.8 m and stands to the left, the thing 0.5 m."""


def texture(side: int, seed: int) -> np.ndarray:
    """(side, side) uint8: spots of all sizes, nowhere alike."""
    rng = np.random.default_rng(seed)
    parts = [cv2.GaussianBlur(rng.normal(size=(side, side)), (0, 0), sigma) * sigma for sigma in (2, 4, 8)]
    spots = sum(parts)
    return np.clip(128 + 45 * spots / spots.std(), 0, 255).astype(np.uint8)


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0, yaw: float = 0.0, pitch: float = 0.0) -> np.ndarray:
    """camera_to_world; metres and degrees."""
    return make_pose(Rotation.from_euler("yx", [yaw, pitch], degrees=True).as_matrix(), np.array([x, y, z]))


def picture(walk: np.ndarray, thing: tuple[float, float] | None = None, textured: bool = True) -> np.ndarray:
    """(SIZE, SIZE) uint8 as seen from a pose; ``thing``: where its corner is [m]."""
    seen = np.full((SIZE, SIZE), 128, np.uint8)
    if textured:
        _paint(seen, walk, texture(900, 0), (-6.0, -6.0), 12.0, WALL)
        _paint(seen, walk, texture(200, 1), (-0.9, -0.4), 0.8, BOARD)
    if thing is not None:
        _paint(seen, walk, texture(150, 2), thing, 0.5, THING)
    return seen


def _paint(
    seen: np.ndarray,
    walk: np.ndarray,
    spots: np.ndarray,
    corner: tuple[float, float],
    side: float,
    depth: float,
) -> None:
    scale = side / len(spots)
    plane = np.array([[scale, 0.0, corner[0]], [0.0, scale, corner[1]], [0.0, 0.0, depth]])
    plane[:, 2] -= walk[:3, 3]
    to_pixels = CAMERA.matrix @ walk[:3, :3].T @ plane
    shift = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    found = np.linalg.inv(shift) @ to_pixels @ shift
    size = (SIZE, SIZE)
    there = cv2.warpPerspective(np.full_like(spots, 255), found, size) == 255
    seen[there] = cv2.warpPerspective(spots, found, size)[there]


@pytest.fixture(scope="session")
def room() -> SimpleNamespace:
    """``room.pose``, ``room.picture``, and its constants."""
    return SimpleNamespace(pose=pose, picture=picture, camera=CAMERA, size=SIZE, board=BOARD)


@pytest.fixture(scope="session")
def walks() -> list[np.ndarray]:
    """Eight steps of 8 cm to the right."""
    return [pose(x=0.08 * frame) for frame in range(8)]


@pytest.fixture(scope="session")
def still(walks) -> list[np.ndarray]:
    """What is seen on that way."""
    return [picture(walk, (0.2, -0.3)) for walk in walks]


@pytest.fixture(scope="session")
def moving(walks) -> list[np.ndarray]:
    """The same while the thing sinks."""
    return [picture(walk, (0.2, -0.4 + 0.05 * frame)) for frame, walk in enumerate(walks)]


@pytest.fixture
def scene(tmp_path) -> Callable[..., Path]:
    """``scene(poses, pictures, **changes)``: a folder with frames.zarr and poses.zarr, five frames a second."""

    def make(walks: list[np.ndarray], pictures: list[np.ndarray], **changes: np.ndarray) -> Path:
        count = len(walks)
        grid = np.linspace(-1.0, 1.0, 12)
        wall = np.stack(np.meshgrid(grid, grid, [WALL]), axis=-1).reshape(-1, 3)
        board = np.stack(np.meshgrid(grid * 0.3 - 0.5, grid * 0.3, [BOARD]), axis=-1).reshape(-1, 3)
        points = np.concatenate([wall, board])
        arrays = {
            "rgb": np.stack([np.stack([one] * 3, axis=-1) for one in pictures]),
            "timestamp_ns": np.arange(count) * 200_000_000,
            "exposure_middle_ns": np.arange(count) * 200_000_000,
            "train": np.arange(count) % 4 != 2,
            "camera_to_world": np.stack(walks),
            "intrinsics": CAMERA.matrix,
            "points/xyz": points,
            "points/rgb": np.zeros((len(points), 3), np.uint8),
        }
        facts = camera_facts(CAMERA, device_from_camera=None)
        put_scene(tmp_path, ["frames", "poses"], arrays | changes, facts, options={"method": "auto"})
        return tmp_path

    return make

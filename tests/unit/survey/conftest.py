"""Images of a room from any pose: a wall, a board in front of it, and an object that may move; also as artifacts."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egosplat.geometry import Camera, make_pose
from tests.support.scenes import camera_facts, put_scene

SIZE = 160
CAMERA = Camera(SIZE, SIZE, 120.0, 120.0, SIZE / 2, SIZE / 2)
WALL, BOARD, OBJECT = 4.0, 2.0, 1.5
"""Depths [m]. The board is 0.8 m wide and on the left, the object is 0.5 m wide."""


def texture(side: int, seed: int) -> np.ndarray:
    """(side, side) uint8: random spots of all sizes."""
    rng = np.random.default_rng(seed)
    parts = [cv2.GaussianBlur(rng.normal(size=(side, side)), (0, 0), sigma) * sigma for sigma in (2, 4, 8)]
    spots = sum(parts)
    return np.clip(128 + 45 * spots / spots.std(), 0, 255).astype(np.uint8)


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0, yaw: float = 0.0, pitch: float = 0.0) -> np.ndarray:
    """(4, 4) camera_to_world; position [m], angles [deg]."""
    return make_pose(Rotation.from_euler("yx", [yaw, pitch], degrees=True).as_matrix(), np.array([x, y, z]))


def image(camera_to_world: np.ndarray, corner: tuple | None = None, textured: bool = True) -> np.ndarray:
    """(SIZE, SIZE) uint8 image from a pose; ``corner``: position of the object [m], None without it."""
    seen = np.full((SIZE, SIZE), 128, np.uint8)
    if textured:
        _paint(seen, camera_to_world, texture(900, 0), (-6.0, -6.0), 12.0, WALL)
        _paint(seen, camera_to_world, texture(200, 1), (-0.9, -0.4), 0.8, BOARD)
    if corner is not None:
        _paint(seen, camera_to_world, texture(150, 2), corner, 0.5, OBJECT)
    return seen


def _paint(seen: np.ndarray, camera_to_world: np.ndarray, spots: np.ndarray, corner, side, depth) -> None:
    scale = side / len(spots)
    plane = np.array([[scale, 0.0, corner[0]], [0.0, scale, corner[1]], [0.0, 0.0, depth]])
    plane[:, 2] -= camera_to_world[:3, 3]
    to_pixels = CAMERA.matrix @ camera_to_world[:3, :3].T @ plane
    shift = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    found = np.linalg.inv(shift) @ to_pixels @ shift
    size = (SIZE, SIZE)
    there = cv2.warpPerspective(np.full_like(spots, 255), found, size) == 255
    seen[there] = cv2.warpPerspective(spots, found, size)[there]


@pytest.fixture(scope="session")
def trajectory() -> list[np.ndarray]:
    """Eight poses, 8 cm apart to the right."""
    return [pose(x=0.08 * frame) for frame in range(8)]


@pytest.fixture(scope="session")
def still(trajectory) -> list[np.ndarray]:
    """Images along ``trajectory`` with the object in place."""
    return [image(pose, (0.2, -0.3)) for pose in trajectory]


@pytest.fixture(scope="session")
def moving(trajectory) -> list[np.ndarray]:
    """Images along ``trajectory`` while the object sinks."""
    return [image(pose, (0.2, -0.4 + 0.05 * frame)) for frame, pose in enumerate(trajectory)]


@pytest.fixture
def scene(tmp_path) -> Callable[..., Path]:
    """``scene(poses, images, **changes)``: a folder with frames.zarr and poses.zarr, five frames per second."""

    def make(trajectory: list[np.ndarray], images: list[np.ndarray], **changes: Any) -> Path:
        count = len(trajectory)
        grid = np.linspace(-1.0, 1.0, 12)
        wall = np.stack(np.meshgrid(grid, grid, [WALL]), axis=-1).reshape(-1, 3)
        board = np.stack(np.meshgrid(grid * 0.3 - 0.5, grid * 0.3, [BOARD]), axis=-1).reshape(-1, 3)
        points = np.concatenate([wall, board])
        arrays = {
            "rgb": np.stack([np.stack([one] * 3, axis=-1) for one in images]),
            "timestamp_ns": np.arange(count) * 200_000_000,
            "exposure_middle_ns": np.arange(count) * 200_000_000,
            "train": np.arange(count) % 4 != 2,
            "camera_to_world": np.stack(trajectory),
            "intrinsics": CAMERA.matrix,
            "points/xyz": points,
            "points/rgb": np.zeros((len(points), 3), np.uint8),
        }
        facts = camera_facts(CAMERA, device_from_camera=None, notes=changes.pop("notes", {}))
        put_scene(tmp_path, ["frames", "poses"], arrays | changes, facts, options={"method": "auto"})
        return tmp_path

    return make

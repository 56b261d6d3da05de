"""Fixtures for tests of poses: rendered images of a room, and trajectory tables. The room is a corner with a
poster in front of it; an image is one homography per plane."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from egosplat.geometry import Camera, invert, make_pose

CAMERA = Camera(240, 180, 210.0, 210.0, 120.0, 90.0)
TEXELS_PER_METER = 120


# Corner, and the sides to the right and downward [m], of textured rectangles; farthest first. World axes are those of an
# upright camera: x right, y down, z forward.
WALL = np.array([(-4.0, -2.6, 4.0), (8.0, 0.0, 0.0), (0.0, 3.8, 0.0)])
FLOOR = np.array([(-4.0, 1.2, 4.0), (8.0, 0.0, 0.0), (0.0, 0.0, -3.2)])
POSTER = np.array([(-0.7, -0.6, 2.6), (1.3, 0.0, 0.3), (0.0, 1.2, 0.0)])
ROOM = (WALL, FLOOR, POSTER)


def texture(plane: NDArray[np.float64], seed: int) -> NDArray[np.uint8]:
    """(h, w, 3) uint8: many overlapping colored discs and boxes of all sizes, a little blurred."""
    rng = np.random.default_rng(seed)
    width, height = (int(np.linalg.norm(side) * TEXELS_PER_METER) for side in plane[1:])
    image = np.full((height, width, 3), 128, np.uint8)
    for _ in range(width * height // 250):
        color = tuple(int(value) for value in rng.integers(0, 256, 3))
        x, y, size = int(rng.integers(width)), int(rng.integers(height)), int(rng.geometric(0.12)) + 2
        if rng.random() < 0.5:
            cv2.circle(image, (x, y), size, color, -1, cv2.LINE_AA)
        else:
            cv2.rectangle(image, (x, y), (x + size, y + int(rng.integers(2, 16))), color, -1)
    return cv2.GaussianBlur(image, (0, 0), 0.8)


def render(pose: NDArray[np.float64], textures: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """(H, W, 3) uint8: the room from the camera pose ``pose`` (4, 4); every plane must lie in front of it."""
    size = (CAMERA.width, CAMERA.height)
    rendered = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    camera_from_world = invert(pose)
    # OpenCV has pixel centers at integers; the package has them at + 0.5.
    center = np.array([[1.0, 0.0, -0.5], [0.0, 1.0, -0.5], [0.0, 0.0, 1.0]])
    for plane, image in zip(ROOM, textures, strict=True):
        sides = plane[1:].T / [image.shape[1], image.shape[0]]
        world = np.vstack([np.column_stack([sides, plane[0]]), [0.0, 0.0, 1.0]])
        homography = center @ CAMERA.matrix @ camera_from_world[:3] @ world @ np.linalg.inv(center)
        drawn = cv2.warpPerspective(image, homography, size, flags=cv2.INTER_LINEAR)
        whole = np.full(image.shape[:2], 255, np.uint8)
        inside = cv2.warpPerspective(whole, homography, size, flags=cv2.INTER_NEAREST)
        rendered = np.where(inside[..., None] > 0, drawn, rendered)
    return rendered


class RenderedRoom:
    """The room, its camera, and camera paths."""

    camera = CAMERA

    def __init__(self) -> None:
        self.textures = [texture(plane, seed) for seed, plane in enumerate(ROOM)]

    def images(self, poses: NDArray[np.float64]) -> list[NDArray[np.uint8]]:
        """An image from each of (N, 4, 4) camera poses."""
        return [render(pose, self.textures) for pose in poses]

    def walk(self, count: int) -> NDArray[np.float64]:
        """(count, 4, 4) poses on an arc, moving sideways and looking at the poster."""
        along = np.linspace(-1.0, 1.0, count)
        position = np.stack([along, 0.3 * np.sin(3.0 * along), 0.5 * along**2 - 0.4], axis=-1)
        angles = np.stack([-0.3 * along, 0.05 * np.cos(4.0 * along), 0.03 * np.sin(5.0 * along)], axis=-1)
        return make_pose(Rotation.from_euler("YXZ", angles).as_matrix(), position)

    def pan(self, count: int) -> NDArray[np.float64]:
        """(count, 4, 4) poses that only rotate."""
        angles = np.zeros((count, 3))
        angles[:, 0] = np.linspace(-0.3, 0.3, count)
        return make_pose(Rotation.from_euler("YXZ", angles).as_matrix(), np.zeros((count, 3)))


@pytest.fixture(scope="session")
def room() -> RenderedRoom:
    """A rendered room with known poses."""
    return RenderedRoom()


@pytest.fixture(scope="session")
def walk_images(room: RenderedRoom) -> list[NDArray[np.uint8]]:
    """Ten images along ``walk(10)``."""
    return room.images(room.walk(10))


def trajectory_table(times_us: ArrayLike, quaternions: NDArray, places: NDArray) -> pd.DataFrame:
    """A trajectory of (N, 4) quaternions xyzw and (N, 3) places [m]; gravity is -y."""
    table: dict[str, object] = {"graph_uid": "a", "tracking_timestamp_us": times_us, "utc_timestamp_ns": -1}
    table |= {f"t{axis}_world_device": places[:, row] for row, axis in enumerate("xyz")}
    table |= {f"q{axis}_world_device": quaternions[:, row] for row, axis in enumerate("xyzw")}
    table |= {f"gravity_{axis}_world": value for axis, value in zip("xyz", (0.0, -9.81, 0.0), strict=True)}
    return pd.DataFrame(table | {"quality_score": 1.0})


@pytest.fixture
def table() -> pd.DataFrame:
    """Five rows at 1 m/s along x and turned about y, 10 ms apart with one gap of 100 ms."""
    times = np.array([1_000_000, 1_010_000, 1_020_000, 1_120_000, 1_130_000])
    turns = Rotation.from_euler("y", [[0.0], [30.0], [90.0], [90.0], [80.0]], degrees=True)
    places = np.stack([times * 1e-6, np.full(5, 1.5), np.full(5, -0.25)], axis=1)
    return trajectory_table(times, turns.as_quat(), places)


@pytest.fixture
def recording(tmp_path: Path) -> Callable[..., Path]:
    """``recording(table, points, closed_loop)``: write a trajectory and points to their paths in ADT."""

    def write(trajectory: pd.DataFrame, points: pd.DataFrame | None = None, closed_loop=False) -> Path:
        (tmp_path / "mps" / "slam").mkdir(parents=True, exist_ok=True)
        name = "mps/slam/closed_loop_trajectory.csv" if closed_loop else "aria_trajectory.csv"
        trajectory.to_csv(tmp_path / name, index=False)
        if points is not None:
            points.to_csv(tmp_path / "mps" / "slam" / "semidense_points.csv.gz", index=False)
        return tmp_path

    return write

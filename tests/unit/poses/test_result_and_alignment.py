"""The checks of ``Poses``, the mean up direction, and trajectory errors."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.colmap.alignment import similarity, trajectory_error
from egosplat.geometry import Camera, make_pose
from egosplat.poses.result import Poses

CAMERA = Camera(64, 48, 50.0, 50.0, 32.0, 24.0)


def random_poses(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return make_pose(Rotation.random(count, rng).as_matrix(), rng.normal(size=(count, 3)))


@pytest.mark.parametrize(
    "broken", [np.full((4, 4, 4), np.nan), random_poses(4) * 1.1, np.eye(4)[None] * np.nan]
)
def test_broken_poses_are_rejected(broken: np.ndarray):
    points, colors = np.zeros((5, 3)), np.zeros((5, 3), np.uint8)
    half = np.where(np.eye(4, dtype=bool), np.nan, np.eye(4))[None]
    for poses in (broken, np.concatenate([random_poses(1), half])):
        with pytest.raises(ValueError):
            Poses(poses, CAMERA, points, colors, np.array([0.0, 1.0, 0.0]), {})


def test_errors_are_root_mean_squares():
    true = random_poses(200)
    rng = np.random.default_rng(1)
    turned = Rotation.from_matrix(true[:, :3, :3]) * Rotation.from_euler("x", 2.0, degrees=True)
    estimated = make_pose(turned.as_matrix(), true[:, :3, 3] + rng.normal(0.0, 0.01, (200, 3)))
    error = trajectory_error(estimated, true)
    assert error["ate_rmse_m"] == pytest.approx(0.01 * np.sqrt(3.0), rel=0.1)
    assert error["rotation_rmse_deg"] == pytest.approx(2.0, rel=0.02)


def test_the_alignment_is_the_least_squares_solution():
    rng = np.random.default_rng(2)
    source, target = rng.normal(size=(30, 3)), rng.normal(size=(30, 3))
    scale, rotation, translation = similarity(source, target)

    def cost(scale: float, turn: np.ndarray, shift: np.ndarray) -> float:
        moved = scale * source @ (Rotation.from_rotvec(turn).as_matrix() @ rotation).T + translation + shift
        return float(np.sum((moved - target) ** 2))

    best = cost(scale, np.zeros(3), np.zeros(3))
    for _ in range(50):
        other = cost(scale * rng.normal(1.0, 0.02), rng.normal(0.0, 0.02, 3), rng.normal(0.0, 0.02, 3))
        assert other >= best
    assert np.linalg.det(rotation) == pytest.approx(1.0)

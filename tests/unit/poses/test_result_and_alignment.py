"""The checks of ``Poses``, the mean up direction, and trajectory errors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.colmap.alignment import align, similarity, trajectory_error
from egosplat.errors import UserError
from egosplat.geometry import Camera, make_pose
from egosplat.poses.result import Poses, mean_camera_up

CAMERA = Camera(64, 48, 50.0, 50.0, 32.0, 24.0)


def random_poses(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return make_pose(Rotation.random(count, rng).as_matrix(), rng.normal(size=(count, 3)))


def valid_poses() -> Poses:
    camera_to_world = random_poses(4)
    camera_to_world[2] = np.nan
    registered = np.array([True, True, False, True])
    points, colours = np.zeros((5, 3)), np.zeros((5, 3), np.uint8)
    return Poses(camera_to_world, registered, CAMERA, points, colours, np.array([0.0, 1.0, 0.0]))


def test_valid_poses_are_accepted():
    poses = valid_poses()
    assert poses.check() is poses


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("camera_to_world", np.full((4, 4, 4), np.nan), "frame 0 is not a rigid"),
        ("camera_to_world", random_poses(4) * 1.1, "frame 0 is not a rigid"),
        ("camera_to_world", random_poses(4), "not registered has a pose"),
        ("camera_to_world", random_poses(3), "camera_to_world is"),
        ("registered", np.zeros(4, np.bool_), "no frame"),
        ("registered", np.ones(4, np.int64), "registered is"),
        ("points", np.full((5, 3), np.inf), "not finite"),
        ("point_rgb", np.zeros((4, 3), np.uint8), "point_rgb is"),
        ("up", np.array([0.0, 2.0, 0.0]), "unit vector"),
        ("up", np.full(3, np.nan), "unit vector"),
    ],
)
def test_broken_poses_are_rejected(field: str, value: np.ndarray, message: str):
    with pytest.raises(ValueError, match=message):
        replace(valid_poses(), **{field: value}).check()


def test_mean_up_of_upright_cameras_and_of_opposite_ones():
    level = make_pose(
        Rotation.from_euler("y", [[0], [90], [200]], degrees=True).as_matrix(), np.zeros((3, 3))
    )
    np.testing.assert_allclose(mean_camera_up(level), [0.0, -1.0, 0.0], atol=1e-12)
    opposed = make_pose(Rotation.from_euler("z", [[0], [180]], degrees=True).as_matrix(), np.zeros((2, 3)))
    with pytest.raises(UserError, match="upright"):
        mean_camera_up(opposed)


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("count", [3, 20])
def test_alignment_inverts_a_similarity_even_for_cameras_in_a_plane(flat: bool, count: int):
    true = random_poses(count)
    true[:, 2, 3] *= not flat
    turn = Rotation.from_rotvec([0.3, -2.0, 0.7]).as_matrix()
    estimated = make_pose(turn @ true[:, :3, :3], 0.2 * true[:, :3, 3] @ turn.T + [5.0, -3.0, 1.0])
    aligned, scale = align(estimated, true)
    np.testing.assert_allclose(aligned, true, atol=1e-10)
    error = trajectory_error(estimated, true)
    assert scale == error["scale"] == pytest.approx(5.0)
    assert error["ate_rmse_m"] < 1e-10
    assert error["rotation_rmse_deg"] < 1e-5


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


def test_degenerate_trajectories_are_rejected():
    line = random_poses(5)
    line[:, :3, 3] = np.outer(np.arange(5.0), [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="one line"):
        trajectory_error(line, random_poses(5))
    still = random_poses(5)
    still[:, :3, 3] = 1.0
    with pytest.raises(ValueError, match="one line"):
        trajectory_error(random_poses(5), still)
    with pytest.raises(ValueError, match="three or more"):
        trajectory_error(random_poses(2), random_poses(2))
    missing = random_poses(5)
    missing[1] = np.nan
    with pytest.raises(ValueError, match="rigid"):
        trajectory_error(missing, random_poses(5))

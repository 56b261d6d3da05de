"""Cameras that do not move or only rotate, and points and poses at their extremes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from egosplat.errors import UserError
from egosplat.gaussians.initialization import scene_extent
from egosplat.geometry import Camera, is_rigid, make_pose
from egosplat.poses.result import Poses, mean_camera_up

CAMERA = Camera(64, 48, 50.0, 50.0, 32.0, 24.0)


def turning(count: int) -> np.ndarray:
    """Cameras in one place that only rotate."""
    turns = Rotation.from_rotvec(np.outer(np.linspace(0, 1, count), [0.1, 1.0, 0.2])).as_matrix()
    return make_pose(turns, np.tile([1.0, 2.0, 3.0], (count, 1)))


@pytest.mark.numerics(
    "scene size: cameras at one place, or that only turn",
    within=0.0,
    outside="10 near planes; no or non-finite camera: ValueError",
)
@pytest.mark.parametrize("count", [1, 2, 30])
def test_size_of_a_scene_without_motion(measured, count):
    measured(abs(scene_extent(turning(count)) - 1.0))
    measured(abs(scene_extent(np.tile(np.eye(4), (count, 1, 1))) - 1.0))
    for poses in (np.zeros((0, 4, 4)), np.full((count, 4, 4), np.nan)):
        with pytest.raises(ValueError, match="not finite"):
            scene_extent(poses)


@pytest.mark.numerics("scene size: 2 to 100 cameras 1 to 1e6 m apart", within=1e-14)
@given(seed=st.integers(0, 999), count=st.integers(2, 100), exponent=st.floats(0.5, 6))
def test_size_of_a_scene(measured, seed, count, exponent):
    places = np.random.default_rng(seed).normal(size=(count, 3)) * 10.0**exponent
    exact = places.astype(np.longdouble)
    truth = max(1.1 * float(np.sqrt(((exact - exact.mean(axis=0)) ** 2).sum(axis=1)).max()), 1.0)
    measured(abs(scene_extent(make_pose(np.eye(3), places)) - truth) / truth)


@pytest.mark.numerics(
    "up direction of cameras that look in all directions", within=1e-12, outside="opposite cameras: UserError"
)
@given(seed=st.integers(0, 999), count=st.integers(1, 50))
def test_up(measured, seed, count):
    angles = np.random.default_rng(seed).uniform(0, 2 * np.pi, count)
    poses = make_pose(Rotation.from_rotvec(np.outer(angles, [0, 1.0, 0])).as_matrix(), np.zeros((count, 3)))
    measured(np.abs(mean_camera_up(poses) - [0, -1, 0]).max())
    opposed = make_pose(Rotation.from_rotvec([[0, 0, 0], [0, 0, np.pi]]).as_matrix(), np.zeros((2, 3)))
    with pytest.raises(UserError, match="upward"):
        mean_camera_up(opposed)


@pytest.mark.numerics("pose scaled, mirrored, sheared by 1e-5, NaN", outside="rejected")
@pytest.mark.parametrize(
    "matrix",
    [np.eye(3) * 1.001, np.diag([-1.0, 1, 1]), np.eye(3) + 1e-5 * np.eye(3, k=1), np.diag([np.nan, 1, 1])],
    ids=["scaled", "mirrored", "sheared", "nan"],
)
def test_invalid_poses_are_rejected(matrix):
    pose = make_pose(matrix, np.zeros(3))
    assert not is_rigid(pose)
    colors, up = np.zeros((0, 3), np.uint8), np.array([0, -1.0, 0])
    with pytest.raises(ValueError, match="rigid|registered"):
        Poses(pose[None], CAMERA, np.zeros((0, 3)), colors, up, {})


@pytest.mark.numerics(
    "projection at z of 1e-300 to 1e300 m", within=1e-12, outside="z of 0 or less: NaN, outside every image"
)
@given(exponent=st.floats(-300, 300))
def test_projection(measured, exponent):
    z = 10.0**exponent
    found = CAMERA.project(np.array([0.1 * z, -0.2 * z, z]))
    measured(float(np.abs(found - [37.0, 14.0]).max()))
    behind = CAMERA.project(np.array([[0.0, 0, 0], [0, 0, -1], [0, 0, -1e-300], [np.nan, 0, 1]]))
    assert not CAMERA.contains(behind).any()

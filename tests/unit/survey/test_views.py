"""Frames that add views are kept, and frames with an unknown view."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egosplat.geometry import Camera, make_pose
from egosplat.survey.views import choose_views, depth_quantile, median_depths, view_change

CAMERA = Camera(100, 100, 50.0, 50.0, 50.0, 50.0)


def pose(x: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    """(4, 4) camera_to_world; position [m], angle [deg]."""
    return make_pose(Rotation.from_euler("y", yaw, degrees=True).as_matrix(), np.array([x, 0.0, z]))


def kept(
    trajectory: list[np.ndarray], least: float = 5.0, rate: float = 30.0, **changes: object
) -> list[int]:
    count = len(trajectory)
    given = {
        "camera_to_world": np.stack(trajectory),
        "depths": np.full(count, 2.0),
        "times_ns": (np.arange(count) / rate * 1e9).astype(np.int64),
        "optional": np.ones(count, bool),
    } | changes
    return np.flatnonzero(choose_views(**given, min_change_deg=least)).tolist()


def test_rotation_and_parallax_add_up():
    assert view_change(pose(), pose(yaw=4.0), 2.0) == pytest.approx(4.0)
    assert view_change(pose(), pose(x=2.0), 2.0) == pytest.approx(45.0)
    assert view_change(pose(), pose(x=2.0, yaw=4.0), 2.0) == pytest.approx(49.0)
    assert view_change(pose(), pose(x=2.0), np.inf) == 0.0
    assert view_change(pose(yaw=33.0), pose(yaw=33.0), 2.0) == pytest.approx(0.0, abs=1e-6)


def test_small_view_changes_accumulate():
    assert kept([pose(yaw=2.0 * k) for k in range(8)]) == [0, 3, 6, 7]
    assert kept([pose(x=0.1 * k) for k in range(8)]) == [0, 2, 4, 6, 7]


def test_large_view_changes_are_kept_and_a_threshold_of_zero_keeps_all():
    assert kept([pose(yaw=6.0 * k) for k in range(8)]) == list(range(8))
    assert kept([pose()] * 8, least=0.0) == list(range(8))


def test_a_still_camera_keeps_one_frame_per_second():
    assert kept([pose()] * 65) == [0, 30, 60, 64]


def test_evaluation_frames_are_kept_and_not_compared():
    optional = np.ones(6, bool)
    optional[[1, 2]] = False
    assert kept([pose()] * 6, optional=optional) == [0, 1, 2, 5]


def test_frames_without_a_pose_or_depth_are_kept():
    trajectory = [pose()] * 3 + [np.full((4, 4), np.nan)] + [pose()] * 2
    depths = np.array([2.0, 2.0, 2.0, np.nan, 2.0, 2.0])
    assert kept(trajectory, depths=depths) == [0, 3, 5]
    assert kept([pose()] * 6, depths=np.full(6, np.nan)) == list(range(6))


@pytest.mark.parametrize("count", [1, 2])
def test_one_or_two_frames_stay(count):
    assert kept([pose()] * count) == list(range(count))


def test_depths_are_those_of_points_inside_the_image():
    points = np.array([[0.0, 0.0, z] for z in np.linspace(1, 3, 21)] + [[0.0, 0.0, -1.0], [9.0, 0.0, 1.0]])
    assert depth_quantile(CAMERA, np.eye(4), points, 0.5) == pytest.approx(2.0)
    assert np.isnan(depth_quantile(CAMERA, np.eye(4), points[:5], 0.5))
    trajectory = np.stack([pose(), pose(yaw=180.0), pose(z=-1.0)])
    found = median_depths(CAMERA, trajectory, np.array([True, True, False]), points)
    assert found[0] == pytest.approx(2.0) and np.isnan(found[1:]).all()


def test_the_depth_of_many_points_uses_a_sample():
    points = np.zeros((120_000, 3))
    points[:, 2] = np.linspace(1, 5, len(points))
    assert depth_quantile(CAMERA, np.eye(4), points, 0.5) == pytest.approx(3.0, abs=1e-3)

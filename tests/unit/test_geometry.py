"""The axis convention agrees with projectaria-tools and with independent formulas."""

import numpy as np
from projectaria_tools.core import calibration
from scipy.spatial.transform import Rotation

from egosplat.geometry import (
    ARIA_PIXEL_OFFSET,
    CLOCKWISE,
    Camera,
    interpolate_poses,
    invert,
    make_pose,
    transform,
)

RNG = np.random.default_rng(0)


def aria_linear(size: int, focal: float) -> calibration.CameraCalibration:
    return calibration.get_linear_camera_calibration(size, size, focal, "test")


def test_projection_equals_arias_plus_half_a_pixel():
    camera, aria = Camera(1408, 1408, 460.0, 460.0, 704.0, 704.0), aria_linear(1408, 460.0)
    points = RNG.uniform([-1, -1, 0.5], [1, 1, 3], (200, 3))
    expected = np.array([aria.project(point) for point in points if aria.project(point) is not None])
    inside = np.array([aria.project(point) is not None for point in points])
    np.testing.assert_allclose(camera.project(points[inside]), expected + ARIA_PIXEL_OFFSET, atol=1e-9)
    assert inside.sum() > 100


def test_the_upright_camera_equals_arias_rotated_one():
    aria = calibration.rotate_camera_calib_cw90deg(aria_linear(1408, 460.0))
    points = RNG.uniform([-1, -1, 0.5], [1, 1, 3], (100, 3))
    in_upright = transform(invert(CLOCKWISE), points)
    in_aria = (aria.get_transform_device_camera().inverse() @ points.T).T
    np.testing.assert_allclose(in_upright, in_aria, atol=1e-9)


def test_resizing_keeps_the_corners():
    camera = Camera(640, 480, 500.0, 510.0, 320.0, 240.0)
    small = camera.scaled_to(160, 120)
    point = np.array([0.3, 0.2, 1.1])
    np.testing.assert_allclose(small.project(point), camera.project(point) / 4)
    assert Camera.from_matrix(camera.matrix, 640, 480) == camera


def test_points_not_in_front_of_the_camera_project_to_nan():
    camera = Camera(64, 64, 50.0, 50.0, 32.0, 32.0)
    pixels = camera.project(np.array([[0, 0, -1.0], [1, 1, 0.0], [0, 0, 1.0], [np.nan, 0, 1]]))
    assert np.isnan(pixels).any(axis=1).tolist() == [True, True, False, True]
    assert camera.contains(pixels).tolist() == [False, False, True, False]
    corners = np.array([[0.0, 0.0], [64.0, 10.0], [63.99, 63.99]])
    assert camera.contains(corners).tolist() == [True, False, True]


def test_interpolation_is_exact_on_rows_and_halves_the_arc():
    rotations = Rotation.from_rotvec([[0, 0, 0], [0, 0, np.pi / 2]]).as_matrix()
    poses = make_pose(rotations, np.array([[0.0, 0, 0], [2.0, 4, 0]]))
    times = np.array([10, 20]) + 87_551_170_813_262_000  # nanoseconds too large for float64
    found = interpolate_poses(times, poses, times[0] + np.array([0, 5, 10]))
    np.testing.assert_allclose(found[[0, 2]], poses, atol=1e-15)
    np.testing.assert_allclose(found[1, :3, 3], [1, 2, 0], atol=1e-15)
    turn = Rotation.from_matrix(found[1, :3, :3]).as_rotvec()
    np.testing.assert_allclose(turn, [0, 0, np.pi / 4], atol=1e-12)

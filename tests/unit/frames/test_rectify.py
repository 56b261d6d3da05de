"""Rectification agrees with projectaria-tools."""

import cv2
import numpy as np
import pytest
from projectaria_tools.core import calibration as aria

from egosplat.frames.rectify import Rectification, linear_calibration, pinhole, supersampling
from egosplat.geometry import ARIA_PIXEL_OFFSET, CLOCKWISE, invert, transform


@pytest.mark.parametrize("upright", [False, True])
def test_device_points_project_like_the_rotated_linear_calibration(fisheye, upright):
    rectification = Rectification(fisheye, pinhole(352), upright)
    rng = np.random.default_rng(3)
    camera_points = np.column_stack([rng.uniform(-1, 1, (200, 2)), rng.uniform(1, 4, 200)])
    device = transform(fisheye.get_transform_device_camera().to_matrix(), camera_points)
    # Their linear calibration carries the pose, so that the whole chain from the device frame is theirs.
    linear = linear_calibration(pinhole(352))
    rotated = aria.rotate_camera_calib_cw90deg(linear) if upright else linear
    to_rotated = rotated.get_transform_device_camera().inverse().to_matrix()
    theirs = [rotated.project_no_checks(point) for point in transform(to_rotated, camera_points)]
    ours = rectification.camera.project(transform(invert(rectification.device_from_camera), device))
    assert np.abs(ours - (np.array(theirs) + ARIA_PIXEL_OFFSET)).max() < 1e-9
    if upright:
        sensor = Rectification(fisheye, pinhole(352), False)
        assert np.allclose(rectification.device_from_camera, sensor.device_from_camera @ CLOCKWISE)


def noise(side: int = 352) -> np.ndarray:
    rng = np.random.default_rng(0)
    return cv2.GaussianBlur(rng.integers(0, 256, (side, side, 3), dtype=np.uint8), (5, 5), 1.5)


@pytest.mark.parametrize("upright", [False, True])
def test_colors_equal_the_librarys_within_a_grey_level(fisheye, upright):
    camera = pinhole(352)
    rectification = Rectification(fisheye, camera, upright)
    assert supersampling(fisheye, camera) == 1
    image = noise()
    theirs = aria.distort_by_calibration(image, linear_calibration(camera), fisheye)
    theirs = np.rot90(theirs, -1) if upright else theirs
    difference = np.abs(theirs.astype(int) - rectification.color(image))[rectification.valid]
    assert difference.max() <= 1


@pytest.mark.parametrize("resolution", [352, 100])
def test_labels_equal_the_librarys(fisheye, resolution):
    camera = pinhole(resolution)
    rectification = Rectification(fisheye, camera, False)
    labels = np.random.default_rng(1).integers(1, 2**60, (352, 352), dtype=np.uint64)
    theirs = aria.distort_label_by_calibration(labels, linear_calibration(camera), fisheye)
    ours = rectification.labels(labels)
    assert ours.dtype == np.uint64
    assert (ours == theirs)[rectification.valid].all()
    assert (ours[~rectification.valid] == 0).all()


@pytest.mark.parametrize("resolution", [352, 88])
def test_valid_pixels_project_into_the_lens_circle_and_the_frame(fisheye, resolution):
    camera = pinhole(resolution)
    rectification = Rectification(fisheye, camera, False)
    factor = supersampling(fisheye, camera)
    side = resolution * factor
    linear = linear_calibration(camera.scaled_to(side, side))
    fine = np.array([[_visible(fisheye, linear, u, v) for u in range(side)] for v in range(side)])
    expected = fine.reshape(resolution, factor, resolution, factor).all(axis=(1, 3))
    assert 0.7 < rectification.valid.mean() < 0.8
    assert (rectification.valid == expected).all()


def _visible(fisheye, linear, u, v) -> bool:
    pixel = fisheye.project(linear.unproject_no_checks(np.array([u, v], dtype=float)))
    # Bilinear sampling needs neighbors on all sides.
    return pixel is not None and bool(0 <= pixel.min() and pixel.max() <= 351)


def test_invalid_pixels_are_black_and_valid_ones_do_not_mix_with_them(fisheye):
    rectification = Rectification(fisheye, pinhole(88), True)
    white = rectification.color(np.full((352, 352, 3), 255, dtype=np.uint8))
    assert (white[rectification.valid] == 255).all()
    assert (white[~rectification.valid] == 0).all()


def test_a_fine_pattern_averages_instead_of_aliasing(fisheye):
    rows, columns = np.mgrid[:352, :352]
    checkers = np.where((rows + columns) % 2, 255, 0).astype(np.uint8)
    image = np.repeat(checkers[..., None], 3, axis=2)
    camera = pinhole(44)
    rectification = Rectification(fisheye, camera, False)
    middle = rectification.color(image)[12:32, 12:32, 0].astype(float)
    naive = aria.distort_by_calibration(image, linear_calibration(camera), fisheye)[12:32, 12:32, 0].astype(
        float
    )
    assert np.abs(middle - 127.5).max() < 20
    assert naive.std() > 3 * middle.std()

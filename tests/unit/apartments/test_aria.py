"""The synthetic device's calibration is well-behaved and is read back exactly as written."""

import numpy as np
import pytest
from projectaria_tools.core.calibration import CameraCalibration, device_calibration_from_json_string

from egosplat.geometry import is_rigid
from egosplat_apartments.adt_format.aria import (
    RGB_LABEL,
    calibration_json,
    camera_calibration,
    device_from_camera,
)

SIZES = [64, 352, 500, 512, 704, 1408]


def pixels_in_lens_circle(calibration: CameraCalibration) -> np.ndarray:
    size = calibration.get_image_size()[0]
    axis = np.linspace(0, size - 1, 25)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    distance = np.linalg.norm(grid - calibration.get_principal_point(), axis=1)
    return grid[distance <= calibration.get_valid_radius() - 1e-6]


@pytest.mark.parametrize("size", SIZES)
def test_calibration_round_trips_through_json(size):
    written = camera_calibration(size)
    read = device_calibration_from_json_string(calibration_json(size)).get_camera_calib(RGB_LABEL)
    assert read.get_image_size().tolist() == [size, size]
    assert read.get_valid_radius() == written.get_valid_radius()
    assert read.get_max_solid_angle() == written.get_max_solid_angle()
    pose = read.get_transform_device_camera().to_matrix()
    np.testing.assert_allclose(pose, device_from_camera(), rtol=0, atol=1e-12)
    for pixel in pixels_in_lens_circle(written):
        ray = written.unproject_no_checks(pixel)
        np.testing.assert_allclose(read.unproject_no_checks(pixel), ray, rtol=0, atol=1e-9)
        np.testing.assert_allclose(read.project_no_checks(ray), pixel, rtol=0, atol=1e-9 * size)


def test_the_lens_circle_is_inside_the_model():
    calibration = camera_calibration(1408)
    for pixel in pixels_in_lens_circle(calibration):
        ray = calibration.unproject(pixel)
        assert ray is not None
        np.testing.assert_allclose(calibration.project(ray), pixel, rtol=0, atol=1e-7)


def test_corners_are_outside_the_lens_circle():
    calibration = camera_calibration(704)
    assert calibration.unproject(np.array([0.0, 0.0])) is None
    assert calibration.unproject(np.array([703.0, 703.0])) is None


def test_field_of_view_does_not_depend_on_the_size():
    large, small = camera_calibration(1408), camera_calibration(352)
    for pixel in pixels_in_lens_circle(small):
        # The same point of the sensor; here pixel centers are at integers.
        same = (pixel + 0.5) * 4 - 0.5
        np.testing.assert_allclose(
            small.unproject_no_checks(pixel), large.unproject_no_checks(same), rtol=0, atol=1e-9
        )


def test_camera_sits_near_the_device_origin():
    pose = device_from_camera()
    assert is_rigid(pose, 1e-12)
    assert 0.005 < np.linalg.norm(pose[:3, 3]) < 0.05

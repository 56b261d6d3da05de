"""Places in the scene."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egosplat.geometry import Camera, invert, make_pose, transform
from egosplat.query.answer import pixel_position, unproject

CAMERA = Camera(64, 48, 50.0, 40.0, 30.0, 25.0)
POSE = make_pose(Rotation.from_euler("xyz", [0.3, -0.5, 0.2]).as_matrix(), np.array([1.0, -2.0, 3.0]))


def test_position_inverts_the_projection():
    rng = np.random.default_rng(0)
    places = transform(POSE, rng.uniform([-1, -1, 1], [1, 1, 5], (20, 3)))
    in_camera = transform(invert(POSE), places)
    found = unproject(CAMERA, POSE, CAMERA.project(in_camera), in_camera[:, 2])
    np.testing.assert_allclose(found, places, atol=1e-12)


def test_the_pixel_of_the_principal_point_is_straight_ahead():
    depth = np.zeros((48, 64), np.float32)
    depth[24, 29] = 2.0
    camera = Camera(64, 48, 50.0, 40.0, 29.5, 24.5)
    np.testing.assert_allclose(pixel_position(camera, np.eye(4), (29, 24), depth), [0.0, 0.0, 2.0])


def test_depth_of_another_resolution():
    depth = np.arange(1, 13, dtype=np.float32).reshape(3, 4)
    found = pixel_position(CAMERA, np.eye(4), (63, 47), depth)
    assert found[2] == 12.0
    np.testing.assert_allclose(CAMERA.project(found), [63.5, 47.5])
    assert pixel_position(CAMERA, np.eye(4), (0, 0), depth)[2] == 1.0


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_without_depth_there_is_no_place(value):
    assert pixel_position(CAMERA, np.eye(4), (3, 4), np.full((48, 64), value, np.float32)) is None

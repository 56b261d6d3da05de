"""Places in the scene."""

import numpy as np
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


def test_depth_may_have_another_resolution():
    depth = np.arange(1, 13, dtype=np.float32).reshape(3, 4)
    found = pixel_position(CAMERA, np.eye(4), (63, 47), depth)
    assert found[2] == 12.0
    np.testing.assert_allclose(CAMERA.project(found), [63.5, 47.5])
    assert pixel_position(CAMERA, np.eye(4), (0, 0), depth)[2] == 1.0

"""Points of given poses lie on the surfaces of the room; poses that are not the frames' have none, and a remedy or an alarm."""

import numpy as np
import pytest

from egosplat.alarms.table import TABLE
from egosplat.errors import UserError
from egosplat.geometry import OPENGL_AXES, invert
from egosplat.poses.options import PosesOptions
from egosplat.poses.points import add_points
from egosplat.poses.result import Poses
from tests.unit.poses.conftest import CAMERA

EVERYWHERE = np.ones((CAMERA.height, CAMERA.width), np.bool_)


def with_points(images, camera_to_world, opengl=False):
    none, up = np.zeros((0, 3)), np.array([0.0, -1.0, 0.0])
    poses = Poses(camera_to_world, CAMERA, none, none.astype(np.uint8), up, {"file": "room/transforms.json"})
    return add_points(poses, (iter(images), EVERYWHERE, None), PosesOptions(), opengl=opengl)


@pytest.fixture(scope="module")
def true_poses(room):
    return room.walk(10)[2:7]


@pytest.mark.parametrize("scale", [1e-3, 1e4])
def test_points_lie_on_the_surfaces_and_the_poses_stay(walk_images, true_poses, scale):
    true_poses = true_poses * np.array([[1.0, 1.0, 1.0, scale]] * 3 + [[1.0] * 4])
    # A frame without a pose has no part.
    poses = with_points(walk_images[2:7], np.concatenate([true_poses, np.full((1, 4, 4), np.nan)]))
    np.testing.assert_array_equal(poses.camera_to_world[:-1], true_poses)
    x, y, z = poses.points.T / scale
    off = np.abs([z - 4.0, y - 1.2, z - 2.6 - (x + 0.7) * 0.3 / 1.3])
    assert np.median(off.min(axis=0)) < 0.02 and np.bincount(off.argmin(axis=0)).min() > 10
    assert poses.notes["reprojection_error_px"] < 0.5 and poses.notes["parallax_deg"] > 5


@pytest.mark.parametrize("opengl, inverted, turned", [(1, 0, 1), (0, 1, 0), (1, 1, 1)])
def test_matrices_of_another_meaning_are_told(walk_images, true_poses, opengl, inverted, turned):
    own = OPENGL_AXES if opengl else np.ones(4)
    written = true_poses * own * OPENGL_AXES if turned else true_poses * own
    written = invert(written) if inverted else written
    with pytest.raises(UserError, match="(?s)^room/transforms.json: .*frames.known_poses=none") as caught:
        with_points(walk_images[2:7], written * own, opengl)
    told = str(caught.value)
    assert ("invert each pose" in told, "second and third column" in told) == (inverted, turned)


def test_poses_of_other_frames_give_hardly_a_point(walk_images, true_poses):
    poses = with_points(walk_images[2:7], true_poses[[3, 0, 4, 1, 2]])
    assert len(poses.points) / 5 < (TABLE["poses.points"].limit or 0)

"""Where a question is asked from."""

import json

import numpy as np
import pytest

from egosplat.errors import UserError
from egosplat.query.finished_scene import open_scene
from egosplat.query.scene import pose_viewpoint


def test_a_frame_is_seen_within_the_lens_circle(word_scene):
    view = open_scene(word_scene()).viewpoint(2)
    assert view.name == "frame 2" and not view.valid[:2].any() and view.valid[2:].all()
    np.testing.assert_array_equal(view.camera_to_world, np.eye(4))


def test_a_frame_is_seen_with_the_pose_that_training_refined(word_scene):
    """Protects queries by frame: the Gaussians fit the refined poses."""
    refined = np.tile(np.eye(4), (4, 1, 1))
    refined[2, 0, 3] = 0.25
    folder = word_scene(corrections={"corrections/camera_to_world": refined})
    np.testing.assert_array_equal(open_scene(folder).viewpoint(2).camera_to_world, refined[2])


@pytest.mark.parametrize(
    "frame, said",
    [(4, "there are 4 frames, 0 to 3"), (-1, "there are 4"), (3, "has no pose; the nearest .* is 2")],
)
def test_invalid_frames_are_rejected(word_scene, frame, said):
    with pytest.raises(UserError, match=f"^frame {frame}: {said}"):
        open_scene(word_scene()).viewpoint(frame)


def test_a_pose_file_may_be_in_any_folder(tmp_path):
    pose = np.eye(4)
    pose[:3, 3] = [1.0, 2.0, 3.0]
    path = tmp_path / "here.json"
    path.write_text(json.dumps({"camera_to_world": pose.tolist()}))
    view = pose_viewpoint(path)
    assert view.name == "here.json" and view.valid is None
    np.testing.assert_array_equal(view.camera_to_world, pose)


@pytest.mark.parametrize(
    "text, said",
    [
        (None, "does not exist"),
        ("{", "is not JSON"),
        ("[]", "is not JSON with 4x4"),
        ("[" * 5000, "nested too deeply"),
        (json.dumps({"camera_to_world": [[10**400]]}), "is not JSON with 4x4"),
        ('{"pose": 1}', "camera_to_world"),
        ('{"camera_to_world": [[1, 2], [3]]}', "is not JSON with 4x4"),
        ('{"camera_to_world": [[1, 2], [3, 4]]}', "not a rigid motion"),
        (json.dumps({"camera_to_world": (2 * np.eye(4)).tolist()}), "not a rigid motion"),
        (json.dumps({"camera_to_world": np.full((4, 4), np.nan).tolist()}), "not a rigid motion"),
    ],
)
def test_files_without_a_pose_are_rejected(tmp_path, text, said):
    path = tmp_path / "pose.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(UserError, match=f"^pose .*pose.json: .*{said}"):
        pose_viewpoint(path)

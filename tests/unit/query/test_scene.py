"""A trained scene is rendered with the settings that it was trained with; where it is asked from."""

import json
from dataclasses import asdict

import numpy as np
import pytest

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import SPLATS
from egosplat.errors import UserError
from egosplat.geometry import Camera
from egosplat.query.finished_scene import open_scene
from egosplat.query.scene import Viewpoint, read_trained_scene
from tests.support.scenes import put

CAMERA = Camera(16, 12, 12.0, 12.0, 8.0, 6.0)


@pytest.fixture
def scene(tmp_path):
    """``scene(background=, degree=)``: one Gaussian ahead, green where its harmonics are used."""

    def make(background: str = "black", degree: int = 1):
        sh = np.zeros((1, 4, 3), np.float32)
        sh[0, 2, 1] = 1.0  # along z
        splats = {"means": np.float32([[0, 0, 2]]), "log_scales": np.full((1, 3), -2.0, np.float32)}
        splats |= {"logit_opacities": np.float32([9.0]), "sh": sh}
        facts = {"camera": asdict(CAMERA), "sh_degree_in_use": degree}
        options = {"near_plane": 0.5, "background": background}
        path = put(tmp_path, "splats", splats, facts, options=options)
        return read_trained_scene(open_artifact(path, SPLATS), "auto")

    return make


@pytest.mark.parametrize("background, expected", [("black", 0.0), ("white", 1.0)])
def test_the_background_is_the_one_of_training(scene, background, expected):
    picture = scene(background).picture(CAMERA, np.eye(4))
    assert picture.shape == (12, 16, 3) and picture.dtype == np.float32
    np.testing.assert_allclose(picture[0, 0], expected, atol=1e-6)
    assert picture[6, 8].std() > 0.1
    # Nothing is seen from behind, nor nearer than the plane.
    near = np.eye(4)
    near[2, 3] = 1.6
    for pose in (near, np.diag([-1.0, 1.0, -1.0, 1.0])):
        np.testing.assert_allclose(scene(background).picture(CAMERA, pose), expected)


def test_harmonics_are_used_up_to_the_degree_in_use(scene):
    with_direction, without = (scene(degree=degree).picture(CAMERA, np.eye(4))[6, 8] for degree in (1, 0))
    assert with_direction[1] > with_direction[0] + 0.1
    np.testing.assert_allclose(without, without[0], atol=1e-6)


def test_a_frame_is_seen_within_the_lens_circle_with_the_pose_that_training_refined(word_scene):
    refined = np.tile(np.eye(4), (4, 1, 1))
    refined[2, 0, 3] = 0.25
    view = open_scene(word_scene(corrections={"corrections/camera_to_world": refined})).viewpoint(2)
    assert view.name == "frame 2" and not view.valid[:2].any() and view.valid[2:].all()
    np.testing.assert_array_equal(view.camera_to_world, refined[2])


@pytest.mark.parametrize("frame, said", [(4, "there are 4"), (3, "has no pose; the nearest .* is 2")])
def test_invalid_frames_are_rejected(word_scene, frame, said):
    with pytest.raises(UserError, match=f"^frame {frame}: {said}"):
        open_scene(word_scene()).viewpoint(frame)


def test_a_pose_file_may_be_in_any_folder(tmp_path):
    pose = np.eye(4)
    pose[:3, 3] = [1.0, 2.0, 3.0]
    (tmp_path / "here.json").write_text(json.dumps({"camera_to_world": pose.tolist()}))
    view = Viewpoint.read(tmp_path / "here.json")
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
        Viewpoint.read(path)

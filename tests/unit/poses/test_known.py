"""Known poses reach the poses artifact as they are, through the frames that they calibrate."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest
from PIL import Image

from egosplat.alarms.artifact_alarms import alarms_of
from egosplat.alarms.table import TABLE
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES, length_unit
from egosplat.errors import UserError
from egosplat.frames.stage import FramesOptions
from egosplat.frames.stage import run as make_frames
from egosplat.geometry import Camera, make_pose
from egosplat.pipeline.config import defaults
from egosplat.poses.result import find_parallax
from egosplat.poses.stage import PosesOptions
from egosplat.poses.stage import run as make_poses
from tests.unit.calibration.conftest import HEIGHT, WIDTH, synthetic_model


def options(kind: type, section: str, **changes: object) -> object:
    return kind(**(defaults()[section] | changes))


@pytest.fixture
def recording(tmp_path):
    """Six pictures, and a COLMAP model of five of them and of one that is not there."""
    (folder := tmp_path / "pictures").mkdir()
    for number in range(6):
        Image.new("RGB", (WIDTH, HEIGHT), (40 * number, 90, 0)).save(folder / f"{number}.png")
    model = synthetic_model()
    for number, image in enumerate(sorted(model.images.values(), key=lambda one: one.image_id)):
        # All cameras upright: the model's own are spread over a sphere.
        image.frame.rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(), [-0.3 * number, 0.1, 4.0])
        image.name = f"{number}.png" if number < 5 else "gone.png"
    (folder / "colmap").mkdir()
    model.write_binary(folder / "colmap")
    return folder


def run(recording: Path, frames: dict[str, object], **poses: object) -> tuple[Artifact, Artifact]:
    made, written = recording.parent / "frames.zarr", recording.parent / "poses.zarr"
    keys = {"resolution": 64, "evaluation_frames": 0} | frames
    make_frames(recording, made, options(FramesOptions, "frames", **keys), format="plain")
    make_poses(recording, made, written, options(PosesOptions, "poses", **poses))
    return open_artifact(made, FRAMES), open_artifact(written, POSES)


def test_a_model_calibrates_the_frames_and_gives_their_poses(recording, capsys):
    frames, poses = run(recording, {"stride": 2})
    assert frames.facts["pictures"] == ["0.png", "2.png", "4.png"] and frames.facts["known_poses"] == "colmap"
    assert frames.facts["entry_of_frame"] == [0, 2, 4], "by all pictures: of fewer, a name may end another's"
    assert frames.facts["lenses"][0]["model"] == "RADIAL" and frames.facts["camera_known"]
    np.testing.assert_array_equal(poses.read("intrinsics"), Camera(**frames.facts["camera"]).matrix)
    assert poses.read("registered").all()
    expected = make_pose(np.eye(3), np.array([[0.6 * i, -0.1, -4] for i in range(3)]))
    np.testing.assert_allclose(poses.read("camera_to_world"), expected, atol=1e-12)
    assert length_unit(poses) == "scene units" and poses.shape("points/xyz")[0] > 20
    told = capsys.readouterr().err
    assert "names without a picture: 1, such as gone.png" in told and "a scene unit" in told


def test_pictures_without_a_pose_are_told_and_left_out(recording, capsys):
    _, poses = run(recording, {})
    assert poses.read("registered").tolist() == [True] * 5 + [False]
    assert np.isnan(poses.read("camera_to_world")[5]).all()
    assert "has no pose of the frames 5 (indices from 0)" in capsys.readouterr().err
    with pytest.raises(UserError, match="(?s)colmap: has poses of 5 of 6 .*poses.min_registered"):
        run(recording, {}, min_registered=0.9)


@pytest.mark.parametrize("behind", [False, True])
def test_without_points_before_cameras_and_features_an_alarm_tells_it(recording, capsys, behind):
    model, turn = pycolmap.Reconstruction(recording / "colmap"), pycolmap.Rotation3d([1.0, 0.0, 0.0, 0.0])
    for image in model.images.values() if behind else ():
        image.frame.rig_from_world = pycolmap.Rigid3d(turn, np.zeros(3)) * image.frame.rig_from_world
    for number in () if behind else [*model.points3D]:
        model.delete_point3D(number)
    model.write_binary(recording / "colmap")
    _, poses = run(recording, {})
    told = capsys.readouterr().err
    assert "texture" in told and ("behind every" in told) == behind and not len(poses.read("points/xyz"))
    assert [alarm.key for alarm in alarms_of(poses)][-1] == "poses.points"


def test_a_still_camera_has_no_parallax():
    points = np.array([[0.0, 0.0, 4.0], [1.0, 0.0, 5.0], [0.0, 1.0, 6.0]])
    moving, still = np.array([[0.0, 0, 0], [0.6, 0, 0]]), np.array([[0.0, 0, 0], [0.3, 0, 0]])
    assert find_parallax(moving, points) > TABLE["poses.parallax"].limit > find_parallax(still, points) > 0
    assert find_parallax(still, points[:0]) is None
    assert find_parallax(still * 0, points * 0) == 0


def test_keys_that_do_not_fit_are_named(recording):
    with pytest.raises(UserError, match="poses.meters_per_unit"):
        run(recording, {"known_poses": "none"}, meters_per_unit=1.0)


def test_a_model_that_changed_after_the_frames_is_refused(recording):
    run(recording, {})
    model = pycolmap.Reconstruction(recording / "colmap")
    (camera,) = model.cameras.values()
    camera.params = [61.0, 31.0, 25.0, 0.05, -0.01]
    model.write_binary(recording / "colmap")
    made = (recording.parent / f"{name}.zarr" for name in ("frames", "poses"))
    with pytest.raises(UserError, match="colmap: has changed since the frames were read"):
        make_poses(recording, *made, options(PosesOptions, "poses"))

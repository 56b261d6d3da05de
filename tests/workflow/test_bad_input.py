"""Bad input gives one or two lines with the error and the remedy, and no output is lost."""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from egosplat.pipeline.stages import PATHS, STAGES
from tests.unit.artifacts.test_artifacts import flip
from tests.unit.frames.conftest import grey_frames, write_video

SCENE = Path("results/adt/scene1")


@pytest.fixture
def scene(finished, tmp_path) -> Path:
    """A private copy of one scene's finished artifacts and recording."""
    return Path(shutil.copytree(finished.folder / SCENE, tmp_path / "scene", symlinks=True))


@pytest.fixture
def refused(run_command, tmp_path) -> Callable[..., str]:
    """Run the command line; it must end with status 2, a short message and nothing new on disk. What it says
    is returned without the path of the test's folder, which holds the test's name."""

    def run(*arguments: object) -> str:
        before = {path for path in tmp_path.rglob("*")}
        status, _, shown = run_command(*arguments)
        assert status == 2 and "Traceback" not in shown, shown
        _, colon, message = shown.rpartition("egosplat: ")  # after lines of progress
        assert colon and len(message.strip().splitlines()) <= 2, shown
        assert {path for path in tmp_path.rglob("*")} == before, "something was left behind"
        return message.replace(f"{tmp_path}/", "")

    return run


@pytest.fixture
def plain_frames(scene, run_command) -> Callable[[Path], Path]:
    """Frames of a plain recording, for what comes after them to fail on."""

    def make(recording: Path) -> Path:
        words = frames(scene, recording=recording, format="plain", resolution=64, evaluation_frames=1)
        assert run_command(*words)[0] == 0
        return scene / "new.zarr"

    return make


def words(command: str, scene: Path, flags: dict[str, object]) -> list[object]:
    """A command with flags, whose output is ``scene/new.zarr`` unless they say otherwise."""
    flags = {"output": scene / "new.zarr"} | flags
    return [command, *(word for name, value in flags.items() for word in _flag(name, value))]


def _flag(name: str, value: object) -> tuple[str, object]:
    """A path, or a key."""
    given = name in (*STAGES, *PATHS, "output", "format", "title")
    return (f"--{name.replace('_', '-')}", value) if given else ("--set", f"{name}={value}")


def frames(scene: Path, **changes: object) -> list[object]:
    flags = {"recording": scene / "recording", "format": "adt", "resolution": 96}
    return words("frames", scene, flags | changes)


def poses(scene: Path, **changes: object) -> list[object]:
    flags = {"recording": scene / "recording", "frames": scene / "frames.zarr"}
    return words("poses", scene, flags | changes)


def annotations(scene: Path) -> list[object]:
    return ["annotations", *poses(scene)[1:]]


def splats(scene: Path, **changes: object) -> list[object]:
    flags = {"frames": scene / "frames.zarr", "poses": scene / "poses.zarr"}
    flags |= {"iterations": 1, "max_points": 50, "masking": "none"}
    return words("splats", scene, flags | changes)


def cut(path: Path, keep: int) -> None:
    path.write_bytes(path.read_bytes()[:keep])


def test_bad_files_of_a_sequence_are_named(scene, refused):
    recording = scene / "recording"
    cut(recording / "segmentations_with_skeleton.vrs", -500)
    assert "segmentations_with_skeleton.vrs: cannot be read" in refused(*annotations(scene))
    (recording / "instances.json").write_text('{"x": {}}')
    assert "recording/instances.json: " in refused(*annotations(scene))
    cut(recording / "video.vrs", -500)
    assert "recording/video.vrs: cannot be read " in refused(*frames(scene))
    (recording / "video.vrs").unlink()
    assert "scene/recording: has no video.vrs or recording.vrs" in refused(*frames(scene))


def test_a_broken_picture_leaves_no_frames(scene, refused, tmp_path):
    (folder := tmp_path / "folder").mkdir()
    for index in range(4):
        cv2.imwrite(str(folder / f"{index}.png"), np.full((64, 64, 3), 128, np.uint8))
    cut(folder / "3.png", 40)
    changes = {"recording": folder, "format": "plain", "resolution": 48}
    assert "folder/3.png: not a readable image" in refused(*frames(scene, **changes))


def test_a_bad_row_of_a_trajectory_is_named_by_its_line(scene, refused):
    file = scene / "recording/mps/slam/closed_loop_trajectory.csv"
    lines = file.read_text().splitlines()
    lines[6] = lines[6].replace(",", ",far", 3)
    file.write_text("\n".join(lines))
    assert "closed_loop_trajectory.csv, line 7" in refused(*poses(scene))


@pytest.mark.parametrize(
    "method, problem", [("device", "has no device trajectory"), ("auto", "0 of 4 frames")]
)
def test_pictures_without_poses_are_refused(scene, refused, plain_frames, tmp_path, method, problem):
    path = write_video(tmp_path / "v.mp4", grey_frames(4))
    changes = {"frames": plain_frames(path), "output": scene / "p.zarr", "method": method}
    assert problem in refused(*poses(scene, recording=path, **changes))


def test_a_damaged_artifact_is_named_by_its_readers_and_by_check(scene, refused):
    flip(scene / "frames.zarr/timestamp_ns/c.0", -6)
    assert "frames.zarr: array 'timestamp_ns'" in refused(*annotations(scene))
    assert "not sound" in refused("check", scene)


def test_poses_of_other_frames_are_refused(scene, refused, plain_frames, tmp_path):
    other = plain_frames(write_video(tmp_path / "v.mp4", grey_frames(4)))
    assert "poses.zarr: was made from another new.zarr" in refused(*splats(scene, frames=other))


def test_a_damaged_picture_is_not_trained_on(scene, refused):
    flip(scene / "frames.zarr/rgb/c.0.0.0.0", 100)
    assert "frames.zarr: array 'rgb', chunk 0" in refused(*splats(scene))


def test_a_full_disk_is_reported_in_one_line(scene, refused, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", str(scene / "new.zarr"))

    monkeypatch.setattr("egosplat.files._sync", full)
    assert "new.zarr: No space left on device" in refused(*frames(scene, evaluation_frames=2))

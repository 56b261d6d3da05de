"""Bad input gives one or two lines with the error and the remedy, and no output is lost."""

import csv
import gzip
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from egosplat import cli

SCENE = Path("results/adt/scene1")


@pytest.fixture
def scene(finished, tmp_path) -> Path:
    """A private copy of one scene's finished artifacts and recording."""
    return Path(shutil.copytree(finished.folder / SCENE, tmp_path / "scene", symlinks=True))


@pytest.fixture
def refused(capfd, monkeypatch, tmp_path) -> Callable[..., str]:
    """Run the command line; it must end with status 2, a short message and nothing new on disk.

    What it says is returned without the path of the test's folder, which holds the test's name.
    """

    def run(*arguments: object) -> str:
        before = {path for path in tmp_path.rglob("*")}
        monkeypatch.setattr("sys.argv", ["egosplat", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        shown = capfd.readouterr().err
        assert stop.value.code == 2, shown
        assert "Traceback" not in shown
        _, colon, message = shown.rpartition("egosplat: ")  # after lines of progress
        assert colon and len(message.strip().splitlines()) <= 2, shown
        assert {path for path in tmp_path.rglob("*")} == before, "something was left behind"
        return message.replace(f"{tmp_path}/", "")

    return run


@pytest.fixture
def plain_frames(scene, monkeypatch) -> Callable[[Path], Path]:
    """Frames of a plain recording, for what comes after them to fail on."""

    def make(recording: Path) -> Path:
        words = frames(scene, recording=recording, format="plain", resolution=64, evaluation_frames=1)
        monkeypatch.setattr("sys.argv", ["egosplat", *map(str, words)])
        cli.main()
        return scene / "new.zarr"

    return make


def frames(scene: Path, **changes: object) -> list[object]:
    flags = {
        "recording": scene / "recording",
        "format": "adt",
        "resolution": 96,
        "output": scene / "new.zarr",
    } | changes
    return [
        "frames",
        *(word for name, value in flags.items() for word in (f"--{name.replace('_', '-')}", value)),
    ]


def poses(scene: Path, **changes: object) -> list[object]:
    flags = {
        "recording": scene / "recording",
        "frames": scene / "frames.zarr",
        "output": scene / "new.zarr",
    } | changes
    return [
        "poses",
        *(word for name, value in flags.items() for word in (f"--{name.replace('_', '-')}", value)),
    ]


def annotations(scene: Path) -> list[object]:
    return ["annotations", *poses(scene)[1:]]


def splats(scene: Path, **changes: object) -> list[object]:
    flags = {
        "frames": scene / "frames.zarr",
        "poses": scene / "poses.zarr",
        "output": scene / "new.zarr",
        "iterations": 1,
        "max-points": 50,
        "masking": "none",
    } | changes
    return ["splats", *(word for name, value in flags.items() for word in (f"--{name}", value))]


def video(path: Path, count: int = 4, size: int = 64) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 10, (size, size))
    for index in range(count):
        writer.write(np.full((size, size, 3), 60 * index, np.uint8))
    writer.release()
    return path


def pictures(folder: Path, count: int = 4, size: int = 64) -> Path:
    folder.mkdir()
    for index in range(count):
        cv2.imwrite(str(folder / f"{index}.png"), np.full((size, size, 3), 128, np.uint8))
    return folder


def test_a_missing_recording(scene, refused):
    assert "scene/nowhere: no such folder" in refused(*frames(scene, recording=scene / "nowhere"))


def test_a_recording_without_video(scene, refused):
    (scene / "recording/video.vrs").unlink()
    assert "recording/video.vrs: not found" in refused(*frames(scene))


@pytest.mark.parametrize(
    "keep, problem",
    [(0, "only 0 bytes"), (60, "only 60 bytes"), (3000, "truncated: 3000 bytes"), (-500, "truncated: ")],
)
def test_a_truncated_vrs_file(scene, refused, keep, problem):
    file = scene / "recording/video.vrs"
    file.write_bytes(file.read_bytes()[:keep])
    assert f"recording/video.vrs: {problem}" in refused(*frames(scene))


def test_a_vrs_file_that_is_something_else(scene, refused):
    (scene / "recording/video.vrs").write_text("hello " * 1000)
    assert "video.vrs: not a VRS file" in refused(*frames(scene))


def test_a_truncated_segmentation(scene, refused):
    file = scene / "recording/segmentations_with_skeleton.vrs"
    file.write_bytes(file.read_bytes()[:-500])
    assert "segmentations_with_skeleton.vrs: truncated" in refused(*annotations(scene))


@pytest.mark.parametrize(
    "text, problem",
    [
        ("", "not readable as JSON"),
        ("{", "not readable as JSON"),
        ("[]", "has no instances"),
        ('{"x": {}}', "instance x lacks"),
    ],
)
def test_unreadable_json(scene, refused, text, problem):
    (scene / "recording/instances.json").write_text(text)
    assert f"recording/instances.json: {problem}" in refused(*annotations(scene))


def test_an_empty_video(scene, refused, tmp_path):
    path = tmp_path / "empty.mp4"
    path.touch()
    assert "empty.mp4: not a video" in refused(*frames(scene, recording=path, format="plain"))


def test_a_folder_without_pictures(scene, refused, tmp_path):
    (tmp_path / "folder").mkdir()
    said = refused(*frames(scene, recording=tmp_path / "folder", format="plain"))
    assert "folder: has no png, jpg or jpeg image" in said


def test_a_picture_of_another_size(scene, refused, tmp_path):
    folder = pictures(tmp_path / "folder")
    cv2.imwrite(str(folder / "2.png"), np.zeros((32, 64, 3), np.uint8))
    assert "folder/2.png: 64x32 px" in refused(
        *frames(scene, recording=folder, format="plain", resolution=48)
    )


def test_a_broken_picture(scene, refused, tmp_path):
    folder = pictures(tmp_path / "folder")
    (folder / "3.png").write_bytes((folder / "3.png").read_bytes()[:40])
    assert "folder/3.png: not a readable image" in refused(
        *frames(scene, recording=folder, format="plain", resolution=48)
    )


def test_a_resolution_that_the_recording_does_not_have(scene, refused, tmp_path):
    assert "resolution: 128 px, but v.mp4 has 64" in refused(
        *frames(scene, recording=video(tmp_path / "v.mp4"), format="plain", resolution=128)
    )


def test_a_time_range_without_frames(scene, refused):
    assert "no frame between start_s and end_s; the last one is at 5.500 s" in refused(
        *frames(scene, start_s=1000)
    )


def test_more_evaluation_frames_than_there_are(scene, refused):
    assert "frames.evaluation_frames: 1000 evaluation frames of 12" in refused(
        *frames(scene, evaluation_frames=1000)
    )


@pytest.mark.parametrize(
    "changes, said",
    [
        ({"resolution": "big"}, "'big' is not a valid integer"),
        ({"resolution": 1}, "--resolution"),
        ({"format": "avi"}, "'avi' is not one of"),
        ({"strid": 2}, "--stride"),
    ],
)
def test_a_wrong_flag(scene, capfd, monkeypatch, changes, said):
    monkeypatch.setattr("sys.argv", ["egosplat", *map(str, frames(scene, **changes))])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    message = capfd.readouterr().err
    assert stop.value.code == 2 and said in message and "Traceback" not in message


def trajectory(scene: Path) -> Path:
    return scene / "recording/mps/slam/closed_loop_trajectory.csv"


def spoil(file: Path, column: str, value: str, row: int = 5) -> None:
    rows = list(csv.DictReader(file.open()))
    for spoiled in rows[row:]:
        spoiled[column] = value
    with file.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


@pytest.mark.parametrize(
    "column, value, problem",
    [
        ("tx_world_device", "nan", "not a finite number"),
        ("tx_world_device", "far", "not a finite number"),
        ("tracking_timestamp_us", "7", "tracking_timestamp_us not after that of the previous row"),
    ],
)
def test_a_trajectory_with_garbage(scene, refused, column, value, problem):
    spoil(trajectory(scene), column, value)
    message = refused(*poses(scene))
    assert "closed_loop_trajectory.csv, line 7" in message and problem in message


def test_a_trajectory_with_zero_quaternions(scene, refused):
    for axis in "xyzw":
        spoil(trajectory(scene), f"q{axis}_world_device", "0")
    message = refused(*poses(scene))
    assert "closed_loop_trajectory.csv, line 7" in message and "quaternion" in message


def test_a_trajectory_without_a_column(scene, refused):
    text = trajectory(scene).read_text()
    trajectory(scene).write_text(text.replace("tx_world_device", "x", 1))
    assert "closed_loop_trajectory.csv has no column tx_world_device" in refused(*poses(scene))


def test_a_missing_trajectory_and_missing_points(scene, refused):
    (scene / "recording/mps/slam/semidense_points.csv.gz").unlink()
    assert "mps/slam has no semidense_points.csv.gz" in refused(*poses(scene))
    trajectory(scene).unlink()
    assert "closed_loop_trajectory.csv is missing" in refused(*poses(scene))


def test_points_that_are_no_gzip(scene, refused):
    (scene / "recording/mps/slam/semidense_points.csv.gz").write_text("uid,graph_uid\n")
    assert "semidense_points.csv.gz is not a readable MPS point cloud" in refused(*poses(scene))


def test_points_that_are_all_uncertain_are_rejected(scene, refused):
    file = scene / "recording/mps/slam/semidense_points.csv.gz"
    lines = gzip.decompress(file.read_bytes()).decode().splitlines()
    bad = [",".join([*line.split(",")[:5], "9.0", "9.0"]) for line in lines[1:]]
    file.write_bytes(gzip.compress("\n".join([lines[0], *bad]).encode()))
    assert f"semidense_points.csv.gz: none of {len(bad)} points passes" in refused(*poses(scene))


def test_a_device_trajectory_asked_of_a_plain_recording(scene, refused, plain_frames, tmp_path):
    path = video(tmp_path / "v.mp4")
    changes = {"frames": plain_frames(path), "output": scene / "p.zarr", "method": "device"}
    assert "poses.method = device: v.mp4 has no device trajectory" in refused(
        *poses(scene, recording=path, **changes)
    )


def test_pictures_that_do_not_reconstruct(scene, refused, plain_frames, tmp_path):
    path = video(tmp_path / "v.mp4")
    changes = {"frames": plain_frames(path), "output": scene / "p.zarr"}
    assert "too little texture: 0 of 4 frames" in refused(*poses(scene, recording=path, **changes))


def test_damaged_artifacts(scene, refused):
    chunk = scene / "frames.zarr/timestamp_ns/c/0"
    content = bytearray(chunk.read_bytes())
    content[-6] ^= 4
    chunk.write_bytes(content)
    assert "frames.zarr: array 'timestamp_ns'" in refused(*annotations(scene))
    assert "not sound" in refused("check", scene)


def test_an_artifact_of_another_kind(scene, refused):
    assert "holds 'poses', not 'frames'" in refused(*poses(scene, frames=scene / "poses.zarr"))


def test_poses_of_other_frames(scene, refused, plain_frames, tmp_path):
    other = plain_frames(video(tmp_path / "v.mp4"))
    assert "poses.zarr: was made from another new.zarr" in refused(*splats(scene, frames=other))


def test_a_damaged_picture_is_not_trained_on(scene, refused):
    chunk = scene / "frames.zarr/rgb/c/0/0/0/0"
    content = bytearray(chunk.read_bytes())
    content[len(content) // 2] ^= 4
    chunk.write_bytes(content)
    assert "frames.zarr: array 'rgb', chunk 0" in refused(*splats(scene))


def test_a_hoi4d_sequence_without_intrinsics(scene, refused, tmp_path):
    sequence = tmp_path / "ZY20210800001/H1/C11/N58/S376/s02/T2"
    (sequence / "align_rgb").mkdir(parents=True)
    video(sequence / "align_rgb/image.mp4")
    assert (
        "no intrinsics. Put HOI4D's camera parameters at camera_params/ZY20210800001/intrin.npy"
        in refused(*frames(scene, recording=sequence, format="hoi4d", resolution=64))
    )


def test_a_check_without_artifacts_is_an_error(refused, tmp_path):
    assert "holds no artifact" in refused("check", tmp_path)


def test_plain_annotations_of_the_wrong_size(scene, refused, plain_frames, tmp_path):
    folder = pictures(tmp_path / "folder")
    (folder / "annotations").mkdir()
    for index in range(4):
        cv2.imwrite(str(folder / f"annotations/{index}.png"), np.zeros((10, 10), np.uint8))
    (folder / "annotations/instances.tsv").write_text(
        "id\tname\tcategory\tmotion_type\n1\tcup_1\tcup\tstatic\n"
    )
    flags = ["--recording", folder, "--frames", plain_frames(folder), "--output", scene / "a.zarr"]
    assert "annotations/2.png: 10x10 px, but the frame is 64x64" in refused("annotations", *flags)


def test_a_full_disk_is_reported_in_one_line(scene, refused, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", str(scene / "new.zarr"))

    monkeypatch.setattr("egosplat.files._sync", full)
    assert "new.zarr: No space left on device" in refused(*frames(scene, evaluation_frames=2))


def test_instances_are_plain_json(scene):
    facts = json.loads((scene / "annotations.zarr/zarr.json").read_text())["attributes"]["egosplat"]["facts"]
    assert {"id", "name", "category", "motion_type", "instance_type"} == set(facts["instances"][0])

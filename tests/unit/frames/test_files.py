"""The rules and the readers of frames and annotations have one list of files: a reader needs no file that it lacks."""

import json
import os
from pathlib import Path

import numpy as np
from PIL import Image

from egosplat.calibration.companions import companion_path
from egosplat.frames.annotations_stage import open_annotations
from egosplat.frames.files import annotations_files, digest_of_files, frames_files, pictures_of
from egosplat.frames.keys import AnnotationKeys
from egosplat.frames.options import FramesOptions
from egosplat.frames.stage import open_recording
from tests.support.recordings import copy_files
from tests.unit.frames.test_hoi4d import FOLDER, root
from tests.unit.frames.test_plain import CALIBRATION, images
from tests.unit.frames.test_plain_annotations import IDS, TABLE

__all__ = ("images", "root")  # fixtures

OPTIONS = FramesOptions(resolution=32, focal=460.0, upright=True)


def files_of(stage: str, format: str, recording: Path) -> list[Path]:
    found = (
        frames_files(format, recording, "auto")
        if stage == "frames"
        else annotations_files(format, recording, "auto")
    )
    return [*found, *pictures_of(stage, format, recording, "auto")]


def read_frames(format: str, recording: Path) -> tuple[np.ndarray, list]:
    """All that a recording gives, and its pictures."""
    reader = open_recording(format, recording, OPTIONS)
    capture, count = reader.capture, len(reader.capture.timestamp_ns)
    told = [
        capture.timestamp_ns.tolist(),
        capture.camera,
        capture.camera_known,
        capture.origin,
        capture.facts,
    ]
    return np.stack([capture.valid[..., None].repeat(3, 2), *reader.read_frames(np.arange(count))]), told


def read_annotations(format: str, recording: Path) -> tuple[list[np.ndarray | None], list]:
    """The instance maps of all frames, and the instances."""
    capture = open_recording(format, recording, OPTIONS).capture
    reader = open_annotations(format, recording, AnnotationKeys(capture.camera, True))
    return [reader.instance_map(int(time)) for time in capture.timestamp_ns], reader.instances


def annotate(recording: Path, names: tuple[str, str]) -> None:
    """Annotate two frames of a plain recording."""
    folder = companion_path(recording, "annotations")
    folder.mkdir()
    (folder / "instances.tsv").write_text(TABLE)
    for name in names:
        Image.fromarray(IDS).save(folder / f"{name}.png")


def check_copies(format: str, top: Path, place: str, target: Path) -> None:
    """Compare what is read of a recording with what is read of copies that have only the listed files."""
    frames = files_of("frames", format, top / place)
    pictures, told = read_frames(format, top / place)
    copied, copied_told = read_frames(format, copy_files(frames, top, target / "frames") / place)
    assert np.array_equal(pictures, copied) and told == copied_told
    every = {*frames, *files_of("annotations", format, top / place)}
    maps, instances = read_annotations(format, top / place)
    again, same = read_annotations(format, copy_files(every, top, target / "annotations") / place)
    assert instances == same and sum(one is not None for one in maps) >= 2
    for one, other in zip(maps, again, strict=True):
        assert (one is None) == (other is None) and (one is None or np.array_equal(one, other))


def test_readers_of_adt_need_the_listed_files_alone(copy, tmp_path):
    check_copies("adt", copy.parent, copy.name, tmp_path / "copies")
    listed = {
        stage: {path.name for path in files_of(stage, "adt", copy)} for stage in ("frames", "annotations")
    }
    assert listed == {
        "frames": {"video.vrs", "metadata.json"},
        "annotations": {"video.vrs", "instances.json", "segmentations_with_skeleton.vrs"},
    }


def test_readers_of_hoi4d_need_the_listed_files_alone(root, tmp_path):
    check_copies("hoi4d", root, FOLDER, tmp_path / "copies")
    named = {path.name for path in files_of("annotations", "hoi4d", root / FOLDER)}
    assert named == {"00000.png", "00003.png"}


def test_readers_of_plain_recordings_need_the_listed_files_alone(images, tmp_path):
    (images / "camera.json").write_text(json.dumps(CALIBRATION))
    (images / "valid.png").write_bytes((images / "2.png").read_bytes())
    annotate(images, ("2", "10"))
    check_copies("plain", images.parent, images.name, tmp_path / "copies")
    (images / "notes.txt").touch()
    assert images / "notes.txt" not in files_of("frames", "plain", images)


def test_readers_of_videos_need_the_listed_files_alone(video, tmp_path):
    clip = video("folder/clip [1].mp4")
    (clip.parent / f"{clip.name}.camera.json").write_text(json.dumps(CALIBRATION))
    annotate(clip, ("0", "00003"))
    check_copies("plain", clip.parent, clip.name, tmp_path / "copies")


def test_a_missing_recording_has_no_files(tmp_path):
    for format in ("adt", "hoi4d", "plain", "lerf", "3d_ovs"):
        for stage in ("frames", "annotations"):
            assert files_of(stage, format, tmp_path / "nowhere") == []


def test_the_digest_follows_an_overwritten_picture_and_no_other_file(images):
    pictures = pictures_of("frames", "plain", images, "auto")
    first = digest_of_files(pictures)
    (images / "notes.txt").touch()
    assert (
        digest_of_files(pictures_of("frames", "plain", images, "auto"))
        == first
        == digest_of_files(pictures[::-1])
    )
    folder, before = images.stat(), (images / "3.png").stat()
    (images / "3.png").write_bytes(bytes(before.st_size))  # of the same size
    os.utime(images, ns=(folder.st_atime_ns, folder.st_mtime_ns))
    os.utime(images / "3.png", ns=(before.st_atime_ns, before.st_mtime_ns + 1))
    assert digest_of_files(pictures) != first


def test_a_broken_link_is_a_file_too(images):
    (images / "annotations").mkdir()
    (images / "annotations/1.png").symlink_to("nowhere.png")
    assert digest_of_files(pictures_of("annotations", "plain", images, "auto"))

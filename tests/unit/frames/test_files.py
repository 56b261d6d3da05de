"""Recordings open by format, and a reader needs no file that the rule does not list."""

import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from egosplat.calibration.files import companion_path, digest_of_recording
from egosplat.errors import UserError
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import AnnotationKeys
from egosplat.geometry import Camera
from egosplat.pipeline.stages import load_module
from tests.support.recordings import copy_files, opened
from tests.unit.frames.test_hoi4d import FOLDER, root
from tests.unit.frames.test_plain import CALIBRATION, images
from tests.unit.frames.test_plain_annotations import IDS, TABLE

__all__ = ("images", "root")  # fixtures

OPTIONS = FramesOptions(resolution=32, upright=True)
STAGES = ("frames", "annotations")
KEYS = AnnotationKeys(Camera(32, 24, 30.0, 30.0, 16.0, 12.0), True)
CONFIG = {"frames": {"known_poses": "auto"}, "poses": {"method": "auto", "trajectory": "closed_loop"}}


def read_frames(format: str, recording: Path) -> tuple[list, list]:
    """What a recording tells, and its pictures."""
    reader = load_module("frames", format).open_recording(recording, OPTIONS)
    times = reader.timestamp_ns.tolist()
    told = [times, reader.camera, reader.camera_known, reader.origin, reader.facts]
    return told, [reader.valid, *reader.read_frames(np.arange(len(times)))]


def read_annotations(format: str, recording: Path) -> tuple[list, list]:
    """The instances, and the instance maps of all frames."""
    capture = load_module("frames", format).open_recording(recording, OPTIONS)
    keys = AnnotationKeys(capture.camera, True)
    reader = load_module("annotations", format).open_annotations(recording, keys)
    return reader.instances, [reader.read(int(time)) for time in capture.timestamp_ns]


def annotate(recording: Path, names: tuple[str, str]) -> None:
    """Annotate two frames of a plain recording."""
    folder = companion_path(recording, "annotations")
    folder.mkdir()
    (folder / "instances.tsv").write_text(TABLE)
    for name in names:
        Image.fromarray(IDS).save(folder / f"{name}.png")


def check_copies(format: str, top: Path, place: str, target: Path) -> None:
    """Compare what is read of a recording with what is read of copies that have only the listed files."""
    listed = set()
    for stage, read in zip(STAGES, (read_frames, read_annotations), strict=True):
        listed |= {*opened(stage, format, top / place)}
        told, arrays = read(format, top / place)
        told_again, copied = read(format, copy_files(listed, top, target / stage) / place)
        assert told == told_again and sum(array is not None for array in arrays) >= 2
        for array, other in zip(arrays, copied, strict=True):
            np.testing.assert_array_equal(array, other)


def test_readers_of_adt_need_the_listed_files_alone(copy, tmp_path):
    check_copies("adt", copy.parent, copy.name, tmp_path / "copies")
    frames, annotations = ({path.name for path in opened(stage, "adt", copy)} for stage in STAGES)
    assert frames == {"video.vrs", "metadata.json"}
    assert annotations == {"video.vrs", "instances.json", "segmentations_with_skeleton.vrs"}


def test_readers_of_hoi4d_need_the_listed_files_alone(root, tmp_path):
    check_copies("hoi4d", root, FOLDER, tmp_path / "copies")
    assert {one.name for one in opened("annotations", "hoi4d", root / FOLDER)} == {"00000.png", "00003.png"}


def test_readers_of_plain_recordings_need_the_listed_files_alone(images, tmp_path):
    (images / "camera.json").write_text(json.dumps(CALIBRATION))
    (images / "valid.png").write_bytes((images / "2.png").read_bytes())
    annotate(images, ("2", "10"))
    check_copies("plain", images.parent, images.name, tmp_path / "copies")
    (images / "notes.txt").touch()
    assert images / "notes.txt" not in opened("frames", "plain", images)


def test_readers_of_videos_need_the_listed_files_alone(video, tmp_path):
    clip = video("folder/clip [1].mp4")
    (clip.parent / f"{clip.name}.camera.json").write_text(json.dumps(CALIBRATION))
    annotate(clip, ("0", "00003"))
    check_copies("plain", clip.parent, clip.name, tmp_path / "copies")


FORMATS = dict.fromkeys(("adt", "lerf", "3d_ovs"), "no such folder")
FORMATS |= {"hoi4d": "not the name of a HOI4D sequence", "plain": "not found"}


@pytest.mark.parametrize("format, problem", FORMATS.items())
def test_a_missing_recording_is_named_with_the_reason_and_has_no_files(tmp_path, format, problem):
    nowhere = tmp_path / "nowhere"
    with pytest.raises(UserError, match=f"nowhere: {problem}"):
        load_module("frames", format).open_recording(nowhere, OPTIONS)
    with pytest.raises(UserError, match=f"nowhere: {problem}"):
        load_module("annotations", format).open_annotations(nowhere, KEYS)
    for stage in STAGES:
        assert opened(stage, format, nowhere) == []


@pytest.fixture
def digest(monkeypatch, tmp_path):
    """The digest of what ``frames`` reads, with a cache of this test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return lambda recording, stage="frames": digest_of_recording(stage, "plain", recording, CONFIG)


@pytest.mark.parametrize("name", ["transforms.json", "clip.mp4"])
def test_the_digest_follows_a_file_that_is_replaced_by_an_older_one(video, images, digest, name):
    recording = video("clip.mp4") if name == "clip.mp4" else images
    file = recording if name == "clip.mp4" else images / name
    file.write_bytes(b"{1}")
    first, other = digest(recording), images / "other"
    other.write_bytes(b"{2}")
    os.utime(other, ns=(0, file.stat().st_mtime_ns - 10**12))
    other.replace(file)
    assert digest(recording) != first


def test_the_digest_reads_bytes_again_only_where_size_time_or_inode_changed(images, digest, monkeypatch):
    first, opened = digest(images), []
    read = hashlib.file_digest
    monkeypatch.setattr(hashlib, "file_digest", lambda file, _: opened.append(file.name) or read(file, _))
    os.utime(images / "2.png", ns=(0, 0))
    (images / "notes.txt").touch()
    assert digest(images) == first and opened == [str(images / "2.png")]
    (images / "3.png").write_bytes(bytes((images / "3.png").stat().st_size))
    assert (changed := digest(images)) != first
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    assert digest(images) == changed, "a user without a home has no cache"


def test_a_broken_link_is_a_file_too_and_a_hidden_file_is_none(images, digest):
    (images / "annotations").mkdir()
    (images / "annotations/._1.png").touch()
    before = digest(images, stage="annotations")
    (images / "annotations/._1.png").unlink()
    assert digest(images, stage="annotations") == before
    (images / "annotations/1.png").symlink_to("nowhere.png")
    assert digest(images, stage="annotations") != before

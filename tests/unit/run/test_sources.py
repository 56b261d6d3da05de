"""What is given to ``egosplat run`` is recognized, or refused with what is wrong."""

import zipfile
from pathlib import Path

import pytest

from egosplat.errors import UserError
from egosplat.run.sources import name_of, read_source, stride_for
from tests.unit.run.conftest import pack, write_pictures


@pytest.mark.parametrize(
    "kind, format, about, options",
    [
        ("video", "plain", "a video of 3 frames", {"frames.stride": "1"}),
        ("folder", "plain", "3 pictures", {}),
        ("nested folder", "plain", "3 pictures", {}),
        ("nerfstudio", "plain", "3 pictures with poses", {}),
        ("zip", "plain", "3 pictures", {}),
        ("nested zip", "plain", "3 pictures", {}),
        ("glasses", "adt", "a recording of Aria glasses with poses", {"poses.trajectory": "closed_loop"}),
    ],
)
def test_each_kind_of_recording_is_recognized(recording, tmp_path, kind, format, about, options):
    given = recording(kind)
    found = read_source(given, tmp_path / "results/recording")
    assert (found.format, found.about.partition(" (")[0], found.options) == (format, about, options)
    assert found.path.is_absolute() and found.path.exists()
    inside = tmp_path / "results" if "zip" in kind else given.parent if format == "adt" else given
    assert found.path == given if kind == "video" else found.path.is_relative_to(inside)


def test_an_archive_is_unpacked_once_and_anew_if_it_changes(recording, tmp_path):
    archive = recording("zip")
    first = read_source(archive, tmp_path / "r/recording").path
    (first / "kept").touch()
    assert read_source(archive, tmp_path / "r/recording").path == first and (first / "kept").exists()
    pack(archive, write_pictures(tmp_path / "more", 4))
    assert read_source(archive, tmp_path / "r/recording").about == "4 pictures"
    assert not list((tmp_path / "r").glob(".*"))


def damaged_archive(path: Path) -> Path:
    path.write_bytes(b"PK not an archive")
    return path


def slipping_archive(path: Path, name: str = "../../evil.png") -> Path:
    with zipfile.ZipFile(path, "w") as opened:
        opened.writestr(name, b"x")
    return path


def text(path: Path) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text("no recording")
    return path


def empty(path: Path) -> Path:
    path.mkdir(parents=True)
    return path


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda here: here / "gone.mp4", "gone.mp4: does not exist"),
        (lambda here: Path("https://example.org/clip.mp4"), "is a URL"),
        (lambda here: empty(here / "photos"), "photos: has no png, jpg or jpeg image"),
        (lambda here: text(here / "photos/a.heic").parent, "1 .heic"),
        (lambda here: text(here / "videos/a.mov").parent, "give one of them, such as"),
        (lambda here: write_pictures(write_pictures(here / "DCIM/100").parent / "101").parent, "100, 101; give one"),
        (lambda here: text(here / "notes.txt"), "notes.txt: is no video"),
        (lambda here: text(here / "clip.mp4"), "clip.mp4: not a video"),
        (lambda here: text(here / "one.jpg"), "one.jpg: is one picture; give the folder"),
        (lambda here: text(here / "photos/a.jpg").parent, "a.jpg: "),
        (lambda here: text(here / "my.vrs"), "video.vrs or recording.vrs"),
        (lambda here: text(here / "video.vrs"), "mps/slam/closed_loop_trajectory.csv: does not exist"),
        (lambda here: damaged_archive(here / "a.zip"), "a.zip: cannot be unpacked"),
        (lambda here: slipping_archive(here / "a.zip"), "evil.png: "),
        (lambda here: slipping_archive(here / "a.zip", "notes.txt"), "has no png, jpg or jpeg image"),
    ],
    ids=lambda value: None if callable(value) else value[:24],
)  # fmt: skip
def test_what_is_no_recording_is_named(tmp_path, make, said):
    with pytest.raises(UserError) as caught:
        read_source(make(tmp_path), tmp_path / "results/recording")
    assert said in str(caught.value)
    assert all("recording-" in str(path) for path in tmp_path.rglob("evil.png")), "none outside"


@pytest.mark.parametrize(
    "given, name",
    [
        ("kitchen.mp4", "kitchen"),
        ("My Küche (1).mp4", "My_K_che_1"),
        ("a.b.zip", "a_b"),
        ("...", "scene"),
        ("walk/video.vrs", "walk"),
    ],
)
def test_a_scene_has_the_name_of_its_file(given, name):
    assert name_of(Path(given)) == name


@pytest.mark.parametrize(
    "count, rate, stride", [(50, 30, 1), (300, 30, 3), (1800, 30, 10), (3600, 60, 20), (900, 2, 1)]
)
def test_a_video_gives_enough_frames_and_not_few(count, rate, stride):
    assert stride_for(count, rate) == stride

"""What is given to ``egosplat run`` is recognized, or refused with what is wrong."""

import io
import zipfile
from pathlib import Path

import pytest

from egosplat.errors import UserError
from egosplat.frames.pictures import stride_for
from egosplat.run.sources import name_of, read_source
from tests.unit.run.conftest import pack, write_pictures


@pytest.mark.parametrize(
    "kind, format, about, options",
    [
        ("video", "plain", "a video of 3 frames", {"frames.stride": "1"}),
        ("video cut off", "plain", "a video of 3 frames", {"frames.stride": "1"}),
        *((kind, "plain", "3 pictures", {}) for kind in ("folder", "nested folder", "zip", "nested zip")),
        *((kind, "plain", "3 pictures with poses", {}) for kind in ("nerfstudio", "zip of Windows")),
        ("glasses", "adt", "a recording of Aria glasses with poses", {"poses.trajectory": "closed_loop"}),
    ],
)
def test_each_kind_of_recording_is_recognized(recording, tmp_path, kind, format, about, options):
    given = recording(kind)
    found = read_source(given, tmp_path / "results/recording")
    assert (found.format, found.about.partition(" (")[0], found.options) == (format, about, options)
    assert found.path.is_absolute() and found.path.exists()
    inside = tmp_path / "results" if "zip" in kind else given.parent if format == "adt" else given
    assert found.path == given if "video" in kind else found.path.is_relative_to(inside)


def test_an_archive_is_unpacked_once_and_anew_if_it_changes(recording, tmp_path):
    archive = recording("zip")
    first = read_source(archive, tmp_path / "r/recording").path
    (first / "kept").touch()
    assert read_source(archive, tmp_path / "r/recording").path == first and (first / "kept").exists()
    pack(archive, write_pictures(tmp_path / "more", 4))
    assert read_source(archive, tmp_path / "r/recording").about == "4 pictures"
    assert not list((tmp_path / "r").glob(".*"))


def zipped(*names: str, content: bytes = b"x") -> bytes:
    with zipfile.ZipFile(archive := io.BytesIO(), "w", zipfile.ZIP_DEFLATED) as opened:
        for name in names:
            opened.writestr(name, content)
    return archive.getvalue()


@pytest.mark.parametrize(
    "given, file, content, said",
    [
        ("gone.mp4", None, b"", "gone.mp4: does not exist"),
        ("https://me:secret@a.org/c.mp4", None, b"", "https:/...@a.org/c.mp4: is a URL"),
        ("empty", "empty/notes.txt", b"x", "empty: has no png, jpg or jpeg image"),
        ("photos", "photos/a.heic", b"x", "1 .heic"),
        ("videos", "videos/a.mov", b"x", "give one of them, such as"),
        ("videos", "videos/._a.mov", b"x", "videos: has no png, jpg or jpeg image"),
        ("k\udcfc.mp4", "k\udcfc.mp4", b"x", "has letters that are not UTF-8"),
        ("DCIM", "DCIM/100/0.png", b"x", "100, 101; give one"),
        ("notes.txt", "notes.txt", b"no recording", "notes.txt: is no video"),
        ("clip.mp4", "clip.mp4", b"no recording", "clip.mp4: not a video"),
        ("one.jpg", "one.jpg", b"x", "one.jpg: is one file of a recording; give its folder"),
        ("transforms.json", "transforms.json", b"{}", "transforms.json: is one file of a recording"),
        ("photos", "photos/a.jpg", b"no picture", "a.jpg: "),
        ("my.vrs", "my.vrs", b"x", "video.vrs or recording.vrs"),
        ("video.vrs", "video.vrs", b"x", "mps/slam/closed_loop_trajectory.csv: does not exist"),
        ("a.zip", "a.zip", b"PK not an archive", "a.zip: cannot be unpacked"),
        ("a.zip", "a.zip", zipped("é.png").replace(b"\xc3", b"\xff"), "a.zip: cannot be unpacked"),
        ("a.zip", "a.zip", zipped("../../evil.png"), "evil.png: "),
        ("a.zip", "a.zip", zipped("notes.txt"), "has no png, jpg or jpeg image"),
        ("a.zip", "a.zip", zipped("a/0.png", "..\\a\\0.png"), "holds a/0.png twice"),
        ("a.zip", "a.zip", zipped("a", "a/0.png"), "a.zip: cannot be unpacked"),
        ("a.zip", "a.zip", zipped("0.png", content=bytes(10**6)), "unpacks to more than 100 times its size"),
        ("DCIM", "DCIM/keyframes/cameras/1.json", b"x", "ns-process-data polycam --data "),
    ],
)
def test_what_is_no_recording_is_named(tmp_path, folder, given, file, content, said):
    write_pictures(Path("DCIM/101"))
    if file:
        Path(file).parent.mkdir(parents=True, exist_ok=True)
        Path(file).write_bytes(content)
    with pytest.raises(UserError) as caught:
        read_source(Path(given), Path("results/recording"))
    assert said in str(caught.value)
    assert all("recording-" in str(path) for path in tmp_path.rglob("evil.png")), "none outside"


@pytest.mark.parametrize(
    "name, told",
    [
        *(("transforms_val.json", "cp "), ("metadata.json", "nerfstudio's")),
        *((name, "give ") for name in ("poses.csv", "transforms.json", "sparse/0/cameras.bin")),
        *(("sparse/1/cameras.txt", "ln -s "), ("distorted/sparse/0/cameras.bin", "ln -s ")),
    ],
)
def test_poses_that_are_not_read_are_told(tmp_path, capsys, name, told):
    write_pictures(folder := tmp_path / "capture/images")
    (folder / "transforms_gone.json").symlink_to("nowhere")
    (folder / "clip.mp4").touch()
    (path := folder.parent / name).parent.mkdir(parents=True, exist_ok=True)
    path.write_text('{"poses": [], "frames": []}')
    read_source(folder, tmp_path / "r")
    said = capsys.readouterr().err
    assert f"{path}: these poses are not read; {told}" in said
    assert "takes its pictures, and not clip.mp4" in said


def test_a_scene_has_the_name_of_its_file():
    names = {"k.mp4": "k", "Küche (1).mp4": "K_che_1", "a.b.zip": "a_b", "...": "scene", "w/video.vrs": "w"}
    assert {given: name_of(Path(given)) for given in names} == names


def test_a_video_gives_enough_frames_and_not_few():
    strides = {(50, 30): 1, (300, 30): 3, (1800, 30): 10, (3600, 60): 20, (900, 2): 1}
    assert {given: stride_for(*given) for given in strides} == strides

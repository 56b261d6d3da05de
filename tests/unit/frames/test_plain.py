"""Plain recordings: videos and image folders, with calibration and mask."""

import errno
import json
import subprocess
from unittest.mock import Mock

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from egosplat.artifacts.reader import verify
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.errors import UserError
from egosplat.frames.options import FramesOptions
from egosplat.frames.pictures import open_recording
from egosplat.frames.stage import run as make_frames
from egosplat.frames.video import open_source, open_video
from egosplat.geometry import Camera

OPTIONS = FramesOptions(resolution=32)
CALIBRATION = {"width": 64, "height": 48, "fx": 50.0, "fy": 51.0, "cx": 30.0, "cy": 24.0}


def ffmpeg(*arguments):
    quiet = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-loglevel", "error"]
    subprocess.run([*quiet, *map(str, arguments)], check=True)


def write_images(folder, names):
    folder.mkdir(exist_ok=True)
    for number, name in enumerate(names):
        Image.new("RGB", (64, 48), (10 * number, 100, 0)).save(folder / name)
    return folder


@pytest.fixture
def images(tmp_path):
    """Twelve images of 64 x 48, 1.png to 12.png, the red of each being its position times ten."""
    return write_images(tmp_path / "images", [f"{number}.png" for number in range(1, 13)])


def reds(recording, indices):
    return [int(image[5, 5, 0]) for image in recording.read_frames(np.array(indices))]


def test_images_come_in_natural_order(images):
    recording = open_recording(images, OPTIONS)
    assert reds(recording, range(12)) == [10 * number for number in range(12)]
    assert recording.timestamp_ns.tolist() == [number * 10**9 for number in range(12)]
    part = open_recording(images, OPTIONS.change(stride=3, start_s=2, end_s=9))
    assert reds(part, [0, 1, 2]) == [20, 50, 80]


def test_frames_are_stored_as_jpeg_where_that_is_asked(images, tmp_path):
    make_frames(images, tmp_path / "frames.zarr", FramesOptions(storage="jpeg"), format="plain")
    rgb = verify(tmp_path / "frames.zarr", SCHEMAS).read("rgb").astype(int)
    assert np.abs(rgb[:, 5, 5] - [[10 * number, 100, 0] for number in range(12)]).max() <= 2
    [shard] = (tmp_path / "frames.zarr/rgb").glob("c*")
    assert shard.read_bytes().startswith(b"\xff\xd8\xff"), "a picture as any program reads it"


@pytest.mark.parametrize("suffix", [".gif", ".TIFF", ".heic", ".exr", ".ppm", ".jp2", ".CR2"])
def test_images_of_other_formats_are_counted(images, capsys, suffix):
    for number in range(3):
        (images / f"more{number}{suffix}").touch()
    assert len(open_recording(images, OPTIONS).timestamp_ns) == 12
    convert = f"magick mogrify -format png {images}/*{suffix}"
    assert f"3 {suffix}: only png and jpg are read. Convert them: {convert}" in capsys.readouterr().err


@pytest.mark.parametrize("first, second", [("a.jpeg", "a.jpg"), ("b.PNG", "b.png"), ("x 1.jpg", "x 1.png")])
def test_two_images_of_one_name_are_rejected_with_both_names(tmp_path, first, second):
    folder = write_images(tmp_path / "twice", ["5.png", first, second, "7.png"])
    with pytest.raises(UserError, match=f"{first} and {second}|{second} and {first}"):
        open_recording(folder, OPTIONS)


def test_a_camera_is_guessed_and_marked_so_unless_a_companion_file_has_it(images, video):
    capture = open_recording(images, OPTIONS)
    assert capture.camera == Camera(32, 24, 1.2 * 32, 1.2 * 32, 16.0, 12.0)
    assert not capture.camera_known and capture.device_from_camera is None and capture.origin == "real"
    for path, name in ((images, "images/camera.json"), (video(), "clip.mp4.camera.json")):
        (images.parent / name).write_text(json.dumps(CALIBRATION))
        capture = open_recording(path, OPTIONS)
        assert capture.camera == Camera(32, 24, 25.0, 25.5, 15.0, 12.0) and capture.camera_known


@pytest.mark.parametrize(
    "content, problem",
    [
        *((text, "not an object with the numbers") for text in ("", "[1]", "null", '{"fx": 1}', "[" * 5000)),
        (json.dumps(CALIBRATION | {"fx": "wide"}), "not an object with the numbers .*'wide'"),
        (json.dumps(CALIBRATION | {"fx": 10**400}), "not an object with the numbers .*too large"),
        (json.dumps(CALIBRATION | {"fx": -1}), "in pixels"),
        (json.dumps(CALIBRATION | {"cx": float("nan")}), r"\(cx, cy\) inside"),
        (json.dumps(CALIBRATION | {"k3": 0.1, "model": "fisheye"}), "k3, model: not read"),
        (json.dumps(CALIBRATION | {"width": 65}), "for 65x48 px, but the upright frames are 64x48"),
    ],
)
def test_a_bad_calibration_is_named(images, content, problem):
    (images / "camera.json").write_text(content)
    with pytest.raises(UserError, match=f"camera.json: .*{problem}"):
        open_recording(images, OPTIONS)


def test_a_resized_mask_keeps_wholly_valid_pixels(images):
    mask = np.full((48, 64), 255, np.uint8)
    mask[:, :9] = 0
    Image.fromarray(mask).save(images / "valid.png")
    recording = open_recording(images, OPTIONS)
    expected = np.ones((24, 32), bool)
    expected[:, :5] = False
    assert (recording.valid == expected).all()
    (image,) = recording.read_frames(np.array([11]))
    assert (image[~expected] == 0).all() and (image[expected] == [110, 100, 0]).all()


TEXTURED = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
BAD_IMAGES = {
    "a mask of another size": ("valid.png", Image.new("L", (63, 48), 255), "63x48"),
    "a black mask": ("valid.png", Image.new("L", (64, 48), 0), "black"),
    "another size": ("7.png", Image.new("RGB", (48, 64)), "48x64 px.*64x48.*COLMAP project"),
    "a broken link": ("13.png", None, "not a readable image"),
    "cut off": ("3.png", Image.fromarray(TEXTURED), ""),
    "16 bits": ("3.png", Image.fromarray(np.zeros((48, 64), np.uint16)), "as of depth"),
}


@pytest.mark.parametrize("kind", BAD_IMAGES)
def test_bad_images_and_masks_are_named(images, kind):
    name, image, problem = BAD_IMAGES[kind]
    image.save(images / name) if image else (images / name).symlink_to("nowhere")
    if kind == "cut off":
        (images / name).write_bytes((images / name).read_bytes()[:5000])
    with pytest.raises(UserError, match=f"{name}.*{problem}"):
        reds(open_recording(images, OPTIONS), [2])


def test_exif_orientation_is_applied(tmp_path):
    image = np.zeros((48, 64, 3), np.uint8)
    image[:24, :, 1] = 200
    exif = Image.Exif()
    exif[0x0112], exif[0x011A] = 6, 72.0  # shown turned clockwise
    Image.fromarray(image).save(path := tmp_path / "a.jpg", exif=exif, quality=95)
    path.write_bytes(path.read_bytes().replace(b"\x01\x1a\0\5", b"\x01\x1a\0\1"))  # damaged: no fraction
    (shown,) = open_recording(tmp_path, OPTIONS.change(resolution=64)).read_frames(np.array([0]))
    assert shown.shape == (64, 48, 3)
    assert shown[:, 40, 1].min() > 150 and shown[:, 8, 1].max() < 50


def test_a_png_without_exif_is_not_decoded_for_its_header_and_a_disk_may_fail(images, monkeypatch):
    monkeypatch.setattr("PIL.PngImagePlugin.PngImageFile.load", None)
    assert open_source(images, None).size == (64, 48)
    monkeypatch.setattr("PIL.Image.open", Mock(side_effect=OSError(errno.EIO, "the disk")))
    with pytest.raises(OSError, match="the disk"):
        open_source(images, None)


def test_area_averaging_does_not_alias(tmp_path):
    checkers = np.indices((48, 64)).sum(axis=0) % 2 * 255
    Image.fromarray(np.repeat(checkers[..., None], 3, axis=2).astype(np.uint8)).save(tmp_path / "0.png")
    (image,) = open_recording(tmp_path, OPTIONS).read_frames(np.array([0]))
    assert np.abs(image.astype(int) - 127).max() <= 1


def test_a_stride_is_advised_where_colmap_would_take_long(video, capsys):
    open_recording(source := video(count=240), OPTIONS)
    assert "240 frames, 15 a second; frames.stride=2" in capsys.readouterr().err
    open_recording(source, OPTIONS.change(stride=2))
    assert "frames.stride" not in capsys.readouterr().err


def test_a_variable_frame_rate_keeps_its_times(video):
    varied = (source := video()).with_name("varied.mp4")
    ffmpeg("-i", source, "-vf", "setpts='if(lt(N,5),N,5+3*(N-5))/15/TB'", "-fps_mode", "vfr", varied)
    times = open_recording(varied, OPTIONS).timestamp_ns * 15e-9
    assert np.abs(times - [0, 1, 2, 3, 4, 5, 8, 11, 14, 17, 20, 23]).max() < 0.01


def test_a_rotated_video_is_shown_upright(video):
    turned = (source := video()).with_name("turned.mp4")
    ffmpeg("-display_rotation", "90", "-i", source, "-c", "copy", turned)
    recording = open_recording(turned, OPTIONS)
    assert (recording.camera.width, recording.camera.height) == (24, 32)
    (image,) = recording.read_frames(np.array([2]))
    # Turned counter-clockwise, the red left half comes to lie below.
    assert image[28, 12, 0] > 200 and image[4, 12, 0] < 60
    ffmpeg("-display_rotation", "180", "-i", source, "-c", "copy", turned)
    assert open_video(turned).pictures[0].orientation == 3


def test_a_truncated_video_is_reported(video, capfd):
    source = video(count=40)
    streamed = source.with_name("streamed.mp4")
    ffmpeg("-i", source, "-c", "copy", "-movflags", "+faststart", streamed)
    content = streamed.read_bytes()
    streamed.write_bytes(content[: int(len(content) * 0.7)])
    recording = open_recording(streamed, OPTIONS)
    assert 1 <= len(recording.timestamp_ns) < 40
    assert "of 40 declared frames" in capfd.readouterr().err

"""Videos as cameras and other programs write them: times out of order, codecs without a decoder, files cut off."""

import shlex
from pathlib import Path

import numpy as np
import pytest

from egosplat.errors import UserError
from egosplat.frames.video import open_video, rebuild_times
from tests.unit.frames.conftest import grey_frames, write_video
from tests.unit.frames.test_plain import ffmpeg

COUNT = 20

# One frame of 64 x 64.
AV1 = bytes.fromhex(
    "444b49460000200041563031400040000f0000000100000001000000000000001f000000000000000000000012000a0a00000002afff"
    "8d5f3008320f1000ba02082041010000080095d08a"
)

ENCODED = {
    "b_frames.avi": ("-c:v", "libx264", "-bf", "3", "-x264-params", "b-adapt=0"),
    "stream.h264": ("-c:v", "libx264", "-bf", "3"),
    **dict.fromkeys(("stream.m2v", "program.mpg"), ("-c:v", "mpeg2video", "-bf", "2", "-r", "25")),
}


@pytest.fixture
def source(tmp_path):
    return write_video(tmp_path / "source.mp4", grey_frames(COUNT), fps=25.0)


@pytest.mark.parametrize("name", ENCODED)
def test_frames_whose_times_are_missing_or_out_of_order_get_even_times(source, capsys, name):
    path = source.with_name(name)
    ffmpeg("-i", source, *ENCODED[name], path)
    video = open_video(path)
    np.testing.assert_allclose(video.timestamp_ns, np.arange(COUNT) * 40e6, atol=1e3)
    greens = [int(frame[20, 48, 1]) for frame in video.read_frames(np.arange(COUNT))]
    assert np.abs(greens - 10 * np.arange(COUNT)).max() <= 5
    assert f"{path}: the times" in (said := capsys.readouterr().err) and "25 a second" in said


@pytest.mark.parametrize(
    ("read", "declared", "step"),
    [
        *(([40, 80, 120, 0], 25.0, 40.0), ([0, 50, 100, 0, 50, 100], 25.0, 50.0)),
        *(([0, 0, 0], 25.0, 40.0), ([0, 0, 0], 0.0, 1e3 / 30), ([90, 60, 30], 50.0, 20.0)),
    ],
)
def test_the_step_is_the_one_between_frames_else_the_declared_one(read, declared, step):
    times, rate = rebuild_times(np.array(read, np.float64), declared)
    np.testing.assert_allclose(times, np.arange(len(read)) * step)
    assert rate == pytest.approx(1e3 / step)


@pytest.mark.parametrize(
    "name, change, problem",
    [
        ("clip.ivf", lambda content: AV1, "codec AV01.*ffmpeg -i .*clip.ivf .*clip_h264.mp4"),
        ("empty.mp4", lambda content: b"", "0 bytes.*Copy it again"),
        ("half.mp4", lambda content: content[: len(content) // 2], "incomplete.*Copy it again"),
    ],
)
def test_a_video_that_cannot_be_read_is_named_with_what_helps(source, name, change, problem, monkeypatch):
    path = source.with_name(name)
    path.write_bytes(change(source.read_bytes()))
    with pytest.raises(UserError, match=f"{name}: .*{problem}") as caught:
        open_video(path)
    assert "0x" not in str(caught.value) and "\n" not in str(caught.value)
    monkeypatch.setattr(Path, "open", lambda path, _: path.with_name("gone").stat())
    with pytest.raises(FileNotFoundError):  # what the system refuses
        open_video(source)


def test_pixels_that_are_not_square_are_refused_with_the_command_that_makes_them(source):
    path = source.with_name("my film.mp4")
    ffmpeg("-i", source, "-c:v", "libx264", "-vf", "setsar=12/11", path)
    with pytest.raises(UserError, match="my film.mp4: its pixels are 12:11") as told:
        open_video(path)
    ffmpeg(*shlex.split(str(told.value).partition("ffmpeg ")[2]))
    assert len(open_video(source.with_name("my film_square.mp4")).timestamp_ns) == COUNT


@pytest.mark.parametrize(("seconds", "incomplete"), [(0.9, False), (6.0, True)])
def test_an_estimated_number_of_frames_is_no_promise(source, capsys, seconds, incomplete):
    """FLV has no number of frames; OpenCV takes it from the duration, here of the sound."""
    path = source.with_name("clip.flv")
    sound = ("-f", "lavfi", "-i", "anullsrc=r=44100", "-t", seconds)
    ffmpeg("-i", source, *sound, "-c:v", "flv1", "-c:a", "pcm_s16le", path)
    assert len(open_video(path).timestamp_ns) == COUNT
    assert ("declared frames" in capsys.readouterr().err) == incomplete

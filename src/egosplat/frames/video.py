"""Read the frames of a video file with OpenCV, or of a folder of images."""

from collections.abc import Iterator
from pathlib import Path
from shlex import quote

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.files import NONE, picture_folders
from egosplat.errors import UserError
from egosplat.frames.images import Picture, Source, open_folder
from egosplat.frames.native_log import captured_log
from egosplat.progress import log, track

# Frames a second of a stream without any time or rate.
_ASSUMED_RATE = 30.0

# Containers that store the number of frames. That of others is estimated from the duration, which sound may lengthen.
_COUNTED = (".mp4", ".m4v", ".mov", ".3gp", ".avi")
# An estimate is wrong by less: frames a second, and a share of all frames.
_SECONDS_OFF, _SHARE_OFF = 1.0, 0.1


class Video(Source):
    """The frames of a video; a rotation in its metadata is applied."""

    def read_frames(self, indices: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """Yield the (height, width, 3) uint8 RGB frame of each index, increasing; UserError if the video ends before."""
        capture, position = _open(self.path), -1
        for frame in [int(self.pictures[index].name) for index in indices]:
            with captured_log() as messages:
                # Seeking in a video is not exact, so every frame before is grabbed.
                while position < frame and capture.grab():
                    position += 1
                decoded, image = capture.retrieve() if position == frame else (False, None)
            if not decoded or image is None:
                told = f"{self.path}: frame {frame} cannot be decoded{_reason(messages)}"
                raise UserError(f"{told}. Exclude it with frames.start_s and frames.end_s.")
            yield np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def open_video(path: Path) -> Video:
    """Scan a video for the presentation times of its frames, which are rebuilt if they do not increase.
    UserError if it is missing, no frame can be decoded, or its pixels are not square."""
    # The frame count and rate in the header are unreliable.
    capture, messages = _open(path), []
    declared, rate = int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), capture.get(cv2.CAP_PROP_FPS)
    grabbed = _grabbed(capture, messages)
    milliseconds = list(track(grabbed, f"scanning {path.name}", total=declared if declared > 0 else None))

    def convert(how: str, end: str) -> str:
        written = path.with_name(f"{path.stem}_{end}.mp4")
        return f"Convert it: ffmpeg -i {quote(str(path))} -c:v libx264 -crf 18 {how}{quote(str(written))}"

    if not milliseconds:
        code = int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little", signed=True)
        letters = code.decode("ascii", "replace")
        codec = f", codec {letters}" if letters.isprintable() else ""
        # ffmpeg also repairs what it can.
        raise UserError(f"{path}: no frame decodes{codec}{_reason(messages)}. {convert('', 'h264')}")
    num, den = capture.get(cv2.CAP_PROP_SAR_NUM), capture.get(cv2.CAP_PROP_SAR_DEN)
    if num != den and min(num, den) > 0:
        # Of an even width, as the encoder needs it.
        command = convert("-vf 'scale=trunc(iw*sar/2)*2:ih,setsar=1' ", "square")
        raise UserError(f"{path}: its pixels are {num:g}:{den:g}, not square. {command}")
    counted = path.suffix.lower() in _COUNTED
    least = declared if counted else (1.0 - _SHARE_OFF) * declared - _SECONDS_OFF * max(rate, 0.0)
    if len(milliseconds) < least or messages:
        readable = f"{len(milliseconds)} of {declared} declared frames can be read{_reason(messages)}"
        log(f"{path}: {readable}; is it complete?")
    times = np.array(milliseconds)
    if not (np.diff(times) > 0).all():
        times, rate = rebuild_times(times, rate)
        log(f"{path}: the times of its frames are missing or out of order; taken as {rate:g} a second")
    since_ns = np.round((times - times[0]) * 1e6).astype(np.int64)
    first = Video(path, [Picture(path, "0", (0, 0))], since_ns[:1])
    height, width = next(first.read_frames(np.array([0]))).shape[:2]
    upside_down = capture.get(cv2.CAP_PROP_ORIENTATION_META) % 360 == 180
    about = {"stored": (width, height), "orientation": 3 if upside_down else 1}
    return Video(path, [Picture(path, str(frame), **about) for frame in range(len(times))], since_ns)


def open_source(path: Path, known_poses: str | None, *, turned: bool | None = None) -> Source:
    """Open a video file or an image folder; UserError if it cannot be read, or pictures without known poses differ in size. EXIF
    orientation is applied, unless ``turned`` says otherwise, without known poses alone: their tools do not turn pictures."""
    if not path.is_dir():
        return open_video(path)
    turned = known_poses is None if turned is None else turned
    source = open_folder(path, picture_folders(path, known_poses or NONE), turned=turned)
    width, height = source.size
    for picture, size in zip(source.pictures, source.sizes, strict=True):
        if known_poses is None and size != (width, height):
            told = f"{size[0]}x{size[1]} px, but most images of the folder are {width}x{height}"
            raise UserError(f"{picture.path}: {told}. Leave other sizes out, or give a COLMAP project.")
    return source


def rebuild_times(milliseconds: NDArray[np.float64], declared: float) -> tuple[NDArray[np.float64], float]:
    """Even times [ms] of frames whose own do not increase, as in AVI with B-frames, raw streams and joined files. Returns the
    frames a second, too: by the median of the steps that go forward, else as ``declared`` by the header."""
    steps = np.diff(milliseconds)
    forward = steps[steps > 0]
    step = float(np.median(forward)) if len(forward) else 1e3 / (declared if declared > 0 else _ASSUMED_RATE)
    return np.arange(len(milliseconds)) * np.float64(step), 1e3 / step


def _open(path: Path) -> cv2.VideoCapture:
    if not path.is_file():
        raise UserError(f"{path}: not found. Check the path.")
    path.open("rb").close()  # a library does not tell that it may not read a file
    if not path.stat().st_size:
        raise UserError(f"{path}: an empty file (0 bytes). Copy it again.")
    with captured_log() as messages:
        capture = cv2.VideoCapture(str(path))
    if not capture.isOpened():
        raise UserError(f"{path}: not a video, or an incomplete one{_reason(messages)}. Copy it again.")
    return capture


def _grabbed(capture: cv2.VideoCapture, messages: list[str]) -> Iterator[float]:
    """Yield the presentation time of each frame [ms] and append the decoder's messages."""
    while True:
        with captured_log() as logged:
            grabbed = capture.grab()
        messages += logged
        if not grabbed:
            return
        yield capture.get(cv2.CAP_PROP_POS_MSEC)


def _reason(messages: list[str]) -> str:
    more = f", and {len(messages) - 1} more" if len(messages) > 1 else ""
    return f" ({messages[0]}{more})" if messages else ""

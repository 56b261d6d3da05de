"""Read the frames of a video file with OpenCV, or of a folder of images."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.files import NONE, picture_folders
from egosplat.errors import UserError
from egosplat.frames.images import ImageFolder
from egosplat.frames.native_log import captured_log
from egosplat.progress import log, track

# Frames a second of a stream without any time or rate.
_ASSUMED_RATE = 30.0

# Containers that store the number of frames. That of others is estimated from the duration, which sound may lengthen.
_COUNTED = (".mp4", ".m4v", ".mov", ".3gp", ".avi")
# An estimate is wrong by less: frames a second, and a share of all frames.
_SECONDS_OFF, _SHARE_OFF = 1.0, 0.1


class Video:
    """Frames and presentation times of a video; a rotation in its metadata is applied, and its pixels are made square.

    Attributes:
        names: numbers of the frames, from 0.
        width, height: size of the frames after rotation, with square pixels [px].
        sizes, turned, oriented: as of an ``ImageFolder``.
        timestamp_ns: (N,) int64: presentation time of each frame since the first, from the container; valid for
            variable frame rates too. Times that do not increase are rebuilt, see ``rebuild_times``.
    """

    turned, oriented = False, 0

    def __init__(self, path: Path) -> None:
        """Scan the video for the times of its frames; UserError if it is missing or no frame can be decoded."""
        self.path = path
        # The frame count and rate in the header are unreliable.
        capture, messages = self._open(), []
        declared, rate = int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), capture.get(cv2.CAP_PROP_FPS)
        frames = _grabbed(capture, messages)
        milliseconds = list(track(frames, f"scanning {path.name}", total=declared if declared > 0 else None))
        if not milliseconds:
            # ffmpeg also repairs what it can.
            raise UserError(
                f"{path}: no frame can be decoded{_codec(capture)}{_reason(messages)}. "
                f"Convert it: ffmpeg -i {path.name} -c:v libx264 -crf 18 {path.stem}_h264.mp4"
            )
        counted = path.suffix.lower() in _COUNTED
        least = declared if counted else (1.0 - _SHARE_OFF) * declared - _SECONDS_OFF * max(rate, 0.0)
        if len(milliseconds) < least or messages:
            log(
                f"{path}: {len(milliseconds)} of {declared} declared frames can be read"
                f"{_reason(messages)}; is it complete?"
            )
        times = np.array(milliseconds)
        if not (np.diff(times) > 0).all():
            times, rate = rebuild_times(times, rate)
            log(f"{path}: the times of its frames are missing or out of order; taken as {rate:g} a second")
        self.timestamp_ns = np.round((times - times[0]) * 1e6).astype(np.int64)
        num, den = capture.get(cv2.CAP_PROP_SAR_NUM), capture.get(cv2.CAP_PROP_SAR_DEN)
        self._pixel_aspect = num / den if num > 0 and den > 0 else 1.0
        self._lies = capture.get(cv2.CAP_PROP_ORIENTATION_META) % 180 == 90
        self.height, self.width = next(self.read_frames(np.array([0]))).shape[:2]
        self.names, self.sizes = [*map(str, range(len(times)))], [(self.width, self.height)] * len(times)
        if self._pixel_aspect != 1.0:
            log(
                f"{path}: its pixels are {num:g}:{den:g}; frames are resampled to square ones, "
                f"{self.width}x{self.height}"
            )

    def read_frames(self, frames: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """Yield the (height, width, 3) uint8 RGB frame of each number, increasing; UserError if the video ends before."""
        capture, position = self._open(), -1
        for frame in frames:
            with captured_log() as messages:
                # Seeking in a video is not exact, so every frame before is grabbed.
                while position < frame and capture.grab():
                    position += 1
                decoded, image = capture.retrieve() if position == frame else (False, None)
            if not decoded or image is None:
                raise UserError(f"{self.path}: frame {frame} cannot be decoded{_reason(messages)}.")
            yield self._squared(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))

    def has_alpha(self, frame: int) -> bool:
        """As of an ``ImageFolder``: no frame has transparent pixels."""
        return False

    def mask(self, frame: int) -> None:
        """As of an ``ImageFolder``: no frame has a mask beside it."""

    def _squared(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """An image with square pixels: its side that was stored as the width is scaled."""
        if self._pixel_aspect == 1.0:
            return image
        height, width = image.shape[:2]
        stored = max(1, round((height if self._lies else width) * self._pixel_aspect))
        size = (width, stored) if self._lies else (stored, height)
        method = cv2.INTER_AREA if self._pixel_aspect < 1.0 else cv2.INTER_LINEAR
        return cv2.resize(image, size, interpolation=method)

    def _open(self) -> cv2.VideoCapture:
        if not self.path.is_file():
            raise UserError(f"{self.path}: not found. Check the path.")
        if not self.path.stat().st_size:
            raise UserError(f"{self.path}: an empty file (0 bytes). Copy it again.")
        with captured_log() as messages:
            capture = cv2.VideoCapture(str(self.path))
        if not capture.isOpened():
            raise UserError(
                f"{self.path}: not a video, or an incomplete one{_reason(messages)}. Copy it again."
            )
        return capture


def open_source(path: Path, known_poses: str | None) -> Video | ImageFolder:
    """Open a video file or an image folder; UserError if it cannot be read.

    Known poses name the pictures, and their tools do not turn them by EXIF orientation.
    """
    if not path.is_dir():
        return Video(path)
    source = ImageFolder(path, picture_folders(path, known_poses or NONE), turned=known_poses is None)
    if known_poses is None:
        source.check_sizes()
    return source


def rebuild_times(milliseconds: NDArray[np.float64], declared: float) -> tuple[NDArray[np.float64], float]:
    """Even times [ms] of frames whose own do not increase, as in AVI with B-frames, raw streams and joined files.

    The decoder yields the frames in the order in which they are shown, whatever their times say. Returns the frames a second,
    too: by the median of the steps that go forward, else as ``declared`` by the header, which raw streams do not have.
    """
    steps = np.diff(milliseconds)
    forward = steps[steps > 0]
    step = float(np.median(forward)) if len(forward) else 1e3 / (declared if declared > 0 else _ASSUMED_RATE)
    return np.arange(len(milliseconds)) * step, 1e3 / step


def _grabbed(capture: cv2.VideoCapture, messages: list[str]) -> Iterator[float]:
    """Yield the presentation time of each frame [ms] and append the decoder's messages."""
    while True:
        with captured_log() as logged:
            grabbed = capture.grab()
        messages += logged
        if not grabbed:
            return
        yield capture.get(cv2.CAP_PROP_POS_MSEC)


def _codec(capture: cv2.VideoCapture) -> str:
    """The four letters of a video's codec, for a message."""
    code = int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little", signed=True)
    letters = code.decode("ascii", "replace")
    return f", codec {letters}" if letters.isprintable() else ""


def _reason(messages: list[str]) -> str:
    more = f", and {len(messages) - 1} more" if len(messages) > 1 else ""
    return f" ({messages[0]}{more})" if messages else ""

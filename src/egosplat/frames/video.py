"""A video file as a source of pictures, by OpenCV."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.frames.native_log import captured_log
from egosplat.progress import log, track


class Video:
    """A video's pictures and when each is shown; a rotation in its metadata is applied.

    Attributes:
        path: the file.
        width, height: of the pictures as shown [px].
        timestamp_ns: (N,) int64: presentation time of each frame after the first, from the container, which
            also holds for a variable frame rate.
    """

    def __init__(self, path: Path) -> None:
        """Run through the video once: neither the frame count nor the rate in a header can be relied on.

        Raises:
            UserError: the file is missing or no frame of it can be decoded.
        """
        self.path = path
        capture, messages = self._open(), []
        declared = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        frames = _grabbed(capture, messages)
        milliseconds = list(track(frames, f"scanning {path.name}", total=declared if declared > 0 else None))
        if not milliseconds:
            raise UserError(f"{path}: no frame of it can be decoded{_because(messages)}.")
        if len(milliseconds) < declared or messages:
            log(
                f"{path}: {len(milliseconds)} of {declared} declared frames can be read"
                f"{_because(messages)}; is it complete?"
            )
        times = np.round(np.array(milliseconds) * 1e6).astype(np.int64)
        self.timestamp_ns = times - times[0]
        self.height, self.width = next(self.pictures(np.array([0]))).shape[:2]

    def pictures(self, frames: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """Yield the (height, width, 3) uint8 RGB picture of each of increasing frame numbers.

        Frames are run through in order, because seeking in a video is not exact.

        Raises:
            UserError: the video ends before the last frame.
        """
        capture, position = self._open(), -1
        for frame in frames:
            with captured_log() as messages:
                while position < frame and capture.grab():
                    position += 1
                done, picture = capture.retrieve() if position == frame else (False, None)
            if not done:
                raise UserError(f"{self.path}: frame {frame} cannot be decoded{_because(messages)}.")
            yield cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)

    def _open(self) -> cv2.VideoCapture:
        if not self.path.is_file():
            raise UserError(f"{self.path}: not found. Check the path.")
        with captured_log() as messages:
            capture = cv2.VideoCapture(str(self.path))
        if not capture.isOpened():
            raise UserError(f"{self.path}: not a video that can be read{_because(messages)}.")
        return capture


def _grabbed(capture: cv2.VideoCapture, messages: list[str]) -> Iterator[float]:
    """Yield each frame's presentation time [ms], collecting what the decoder complains of."""
    while True:
        with captured_log() as complaints:
            done = capture.grab()
        messages += complaints
        if not done:
            return
        yield capture.get(cv2.CAP_PROP_POS_MSEC)


def _because(messages: list[str]) -> str:
    more = f", and {len(messages) - 1} more" if len(messages) > 1 else ""
    return f" ({messages[0]}{more})" if messages else ""

"""Read plain recordings: any video file or folder of images, with the companion files of docs/recordings.md."""

import math
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.files import read_json
from egosplat.frames.images import VALID_MASK, ImageFolder, read_valid
from egosplat.frames.recording import Capture
from egosplat.frames.recording_files import companion_path
from egosplat.frames.resize import resize_image, resize_mask
from egosplat.frames.selection import select_frames
from egosplat.frames.video import Video
from egosplat.geometry import Camera

# Guessed focal length in units of the longer side: COLMAP's default, a field of view of 45°.
FOCAL_PRIOR = 1.2

_CAMERA_KEYS = ("width", "height", "fx", "fy", "cx", "cy")


class PlainRecording:
    """A video or a folder of images; a ``Recording`` without a device frame."""

    def __init__(
        self, path: Path, *, resolution: int, stride: int, start_s: float, end_s: float | None
    ) -> None:
        """Open the source and select frames.

        Args:
            path: video file or image folder.
            resolution: longer side of the frames [px], at most the source's.
            stride, start_s, end_s: see ``selection.select_frames``; a folder has one image per second.

        Raises:
            UserError: the source cannot be read, or an option is out of range.
        """
        self._source = open_source(path)
        full = _guess_camera(self._source.width, self._source.height)
        calibrated = _read_camera(companion_path(path, "camera.json"), full)
        width, height = fit(full, resolution, path)
        camera = (calibrated or full).scaled_to(width, height)
        # At full size, so that a reduced pixel is valid only if all its pixels are.
        valid = read_valid(companion_path(path, VALID_MASK), full.width, full.height)
        times = self._source.timestamp_ns
        self._frames = select_frames(times, stride=stride, start_s=start_s, end_s=end_s, source=path)
        self.capture = Capture.of_video(
            times[self._frames], camera, calibrated is not None, resize_mask(valid, width, height)
        )

    def read_frames(self, indices: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """Yield the (H, W, 3) uint8 RGB frame of each index; see ``Recording.read_frames``.

        Raises:
            UserError: a frame cannot be decoded.
        """
        camera = self.capture.camera
        for full in self._source.read_frames(self._frames[indices]):
            image = resize_image(full, camera.width, camera.height)
            image[~self.capture.valid] = 0
            yield image


def open_source(path: Path) -> Video | ImageFolder:
    """Open a video file or an image folder.

    Raises:
        UserError: the source is missing or cannot be read.
    """
    return ImageFolder(path) if path.is_dir() else Video(path)


def fit(full: Camera, resolution: int, path: Path) -> tuple[int, int]:
    """Width and height of frames whose longer side is ``resolution`` [px].

    Raises:
        UserError: ``resolution`` is not positive, or would enlarge the frames.
    """
    longest = max(full.width, full.height)
    if not 1 <= resolution <= longest:
        raise UserError(f"resolution: {resolution} px, but {path} has {longest}. Choose from 1 to {longest}.")
    return tuple(max(1, round(side * resolution / longest)) for side in (full.width, full.height))


def _guess_camera(width: int, height: int) -> Camera:
    focal = FOCAL_PRIOR * max(width, height)
    return Camera(width, height, focal, focal, width / 2, height / 2)


def _read_camera(path: Path, full: Camera) -> Camera | None:
    """Read the calibration for the size of ``full``; None if the file does not exist."""
    # A broken link is not a missing file: reading it reports the error.
    if not os.path.lexists(path):
        return None
    try:
        entries = read_json(path)
        numbers = [float(entries[key]) for key in _CAMERA_KEYS]
    except (OSError, ValueError, TypeError, KeyError, OverflowError) as error:
        raise UserError(
            f"{path}: not an object with the numbers {', '.join(_CAMERA_KEYS)} ({repr(error)[:200]})."
        ) from error
    width, height, fx, fy, cx, cy = numbers
    if (width, height) != (full.width, full.height):
        raise UserError(
            f"{path}: for {width:g}x{height:g} px, but the frames are {full.width}x{full.height}."
        )
    camera = Camera(full.width, full.height, fx, fy, cx, cy)
    if not (all(map(math.isfinite, numbers)) and min(fx, fy) > 0 and camera.contains(np.array([cx, cy]))):
        raise UserError(f"{path}: fx, fy must be positive and (cx, cy) inside the image.")
    return camera

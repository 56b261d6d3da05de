"""Plain recordings: any video file or folder of images.

Files beside it, all optional (``X`` is the video's file name with its extension, ``clip.mp4``):

==================  =======================  ==================================================
image folder        video                    what
==================  =======================  ==================================================
``camera.json``     ``X.camera.json``        calibration, an object with the numbers ``width``,
                                             ``height``, ``fx``, ``fy``, ``cx``, ``cy`` in
                                             pixels of the full-size pictures, without
                                             distortion; pixel centres at integer + 0.5
``valid.png``       ``X.valid.png``          full-size mask, black where nothing of the scene
                                             is seen
``annotations/``    ``X.annotations/``       see ``plain_annotations``
==================  =======================  ==================================================
"""

import math
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.files import read_json
from egosplat.frames.companions import companion
from egosplat.frames.images import VALID_MASK, ImageFolder, read_valid
from egosplat.frames.recording import Capture
from egosplat.frames.resize import resize_mask, resize_picture
from egosplat.frames.selection import select_frames
from egosplat.frames.video import Video
from egosplat.geometry import Camera

FOCAL_PRIOR = 1.2
"""Focal length of an unknown camera in units of the longer side, COLMAP's default: a field of view of 45°."""

_CAMERA_KEYS = ("width", "height", "fx", "fy", "cx", "cy")


class PlainRecording:
    """A video or a folder of images; a ``Recording`` without device frame."""

    def __init__(
        self, path: Path, *, resolution: int, stride: int, start_s: float, end_s: float | None
    ) -> None:
        """Open the source and select frames.

        Args:
            path: video file or image folder.
            resolution: longer side of the pictures [px], at most the source's.
            stride, start_s, end_s: see ``selection.select_frames``; an image folder counts one second an image.

        Raises:
            UserError: the source cannot be read, or an option is out of range.
        """
        self._source = open_source(path)
        full = Camera(
            self._source.width, self._source.height, *_guess(self._source.width, self._source.height)
        )
        calibrated = _read_camera(companion(path, "camera.json"), full)
        width, height = fit(full, resolution, path)
        camera = (calibrated or full).scaled_to(width, height)
        valid = read_valid(companion(path, VALID_MASK), full.width, full.height)
        times = self._source.timestamp_ns
        self._frames = select_frames(times, stride=stride, start_s=start_s, end_s=end_s, source=path)
        self.capture = Capture.of_video(
            times[self._frames], camera, calibrated is not None, resize_mask(valid, width, height)
        )

    def pictures(self, indices: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """Yield the (H, W, 3) uint8 RGB picture of each index; see ``Recording.pictures``.

        Raises:
            UserError: a picture cannot be decoded.
        """
        camera = self.capture.camera
        for source in self._source.pictures(self._frames[indices]):
            picture = resize_picture(source, camera.width, camera.height)
            picture[~self.capture.valid] = 0
            yield picture


def open_source(path: Path) -> Video | ImageFolder:
    """Open a video file or an image folder.

    Raises:
        UserError: it is missing or cannot be read.
    """
    return ImageFolder(path) if path.is_dir() else Video(path)


def fit(full: Camera, resolution: int, path: Path) -> tuple[int, int]:
    """Width and height [px] whose longer side is ``resolution``.

    Raises:
        UserError: ``resolution`` is not positive, or would enlarge the pictures.
    """
    longest = max(full.width, full.height)
    if not 1 <= resolution <= longest:
        raise UserError(f"resolution: {resolution} px, but {path} has {longest}. Choose from 1 to {longest}.")
    return tuple(max(1, round(side * resolution / longest)) for side in (full.width, full.height))


def _guess(width: int, height: int) -> tuple[float, float, float, float]:
    focal = FOCAL_PRIOR * max(width, height)
    return focal, focal, width / 2, height / 2


def _read_camera(path: Path, full: Camera) -> Camera | None:
    """The calibration file, or None where there is none. A link that leads nowhere is not none."""
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
            f"{path}: for {width:g}x{height:g} px, but the pictures are {full.width}x{full.height}."
        )
    camera = Camera(full.width, full.height, fx, fy, cx, cy)
    if not (all(map(math.isfinite, numbers)) and min(fx, fy) > 0 and camera.contains(np.array([cx, cy]))):
        raise UserError(f"{path}: fx, fy must be positive and (cx, cy) inside the picture.")
    return camera

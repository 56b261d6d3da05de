"""Aria Digital Twin recordings: the pictures of ``video.vrs``, rectified. Nothing else of a sequence is read
but ``metadata.json``, for the recording's origin (docs/method.md#adt-files)."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from projectaria_tools.core import data_provider
from projectaria_tools.core.calibration import DeviceCalibration
from projectaria_tools.core.data_provider import VrsDataProvider
from projectaria_tools.core.sensor_data import TimeDomain
from projectaria_tools.core.stream_id import StreamId

from egosplat.errors import UserError
from egosplat.frames.native_log import captured_log, damage, report
from egosplat.frames.origin import recording_origin
from egosplat.frames.recording import Capture
from egosplat.frames.rectify import Rectification, pinhole
from egosplat.frames.selection import select_frames
from egosplat.frames.upright import clockwise_turns
from egosplat.frames.vrs import check_complete, check_log
from egosplat.geometry import Camera

RGB_LABEL = "camera-rgb"
RGB_STREAM = StreamId("214-1")
EXPOSURE_MIDDLE_AFTER_CAPTURE_NS = 2_500_000
"""From a capture timestamp to the middle of the picture: half of the rolling shutter (docs/method.md#exposure-time)."""


class AdtRecording:
    """The RGB pictures of a sequence folder; a ``Recording``."""

    def __init__(
        self,
        folder: Path,
        *,
        resolution: int,
        focal: float,
        upright: bool,
        stride: int,
        start_s: float,
        end_s: float | None,
    ) -> None:
        """Open ``video.vrs`` and select frames; pictures are decoded only when asked for.

        Args:
            folder: the sequence folder.
            resolution: side of the rectified pictures [px].
            focal: focal length of the rectified pictures [px] if they were 1408 px wide (the paper: 460).
            upright: whether pictures are turned upright; the sensor of Aria gen1 lies on its side.
            stride, start_s, end_s: see ``selection.select_frames``.

        Raises:
            UserError: the folder or ``video.vrs`` is missing or damaged, or an option is out of range.
        """
        camera = pinhole(resolution, focal)
        self._path = folder / "video.vrs"
        self._provider = open_video(folder)
        timestamps = np.array(
            self._provider.get_timestamps_ns(RGB_STREAM, TimeDomain.DEVICE_TIME), dtype=np.int64
        )
        if not len(timestamps):
            raise UserError(f"{self._path}: holds no RGB picture. Download it again.")
        self._frames = select_frames(
            timestamps, stride=stride, start_s=start_s, end_s=end_s, source=self._path
        )
        device = device_calibration(self._provider, self._path)
        self._rectification = rectification(device, camera, upright, self._path)
        capture_ns = timestamps[self._frames]
        self.capture = Capture(
            timestamp_ns=capture_ns,
            exposure_middle_ns=capture_ns + EXPOSURE_MIDDLE_AFTER_CAPTURE_NS,
            camera=self._rectification.camera,
            camera_known=True,
            device_from_camera=self._rectification.device_from_camera,
            valid=self._rectification.valid,
            origin=recording_origin("adt", folder),
            upright=upright or clockwise_turns(device, RGB_LABEL) == 0,
        )

    def pictures(self, indices: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """Yield the (H, W, 3) uint8 RGB picture of each index; see ``Recording.pictures``.

        Raises:
            UserError: a picture cannot be decoded or is black.
        """
        for index in indices:
            source = self._decode(int(self._frames[index]))
            try:
                picture = self._rectification.colour(source)
            except ValueError as error:
                raise UserError(f"{self._path}: RGB frame {self._frames[index]}: {error}.") from error
            if not picture.any():
                raise UserError(
                    f"{self._path}: RGB frame {self._frames[index]} is black. Leave it out by start_s/end_s."
                )
            yield picture

    def _decode(self, frame: int) -> NDArray[np.uint8]:
        try:
            with captured_log() as messages:
                data, _ = self._provider.get_image_data_by_index(RGB_STREAM, frame)
                picture = data.to_numpy_array() if data.is_valid() else None
        except RuntimeError as error:
            picture, messages = None, [*messages, str(error)]
        # A damaged JPEG is decoded to whatever comes out, with no more than a line in the log.
        reason = damage(messages)
        if picture is None or picture.ndim != 3 or reason:
            reason = reason or "; ".join(messages) or "not a colour picture"
            raise UserError(
                f"{self._path}: RGB frame {frame} cannot be decoded ({reason}). Download it again."
            )
        report(messages, self._path)
        return picture


def open_video(folder: Path) -> VrsDataProvider:
    """Open a sequence's ``video.vrs``, known to be complete and to have an RGB stream with a calibration.

    Raises:
        UserError: it is not so.
    """
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder. Give the folder of an ADT sequence.")
    path = folder / "video.vrs"
    check_complete(path)
    try:
        with captured_log() as messages:
            provider = data_provider.create_vrs_data_provider(str(path))
    except RuntimeError as error:
        raise UserError(f"{path}: cannot be read ({error}). Download it again.") from error
    if provider is None:
        raise UserError(f"{path}: cannot be read ({'; '.join(messages)}). Download it again.")
    check_log(path, messages)
    report(messages, path)
    if not provider.check_stream_is_active(RGB_STREAM):
        raise UserError(f"{path}: has no RGB stream (214-1). It must be the video.vrs of an ADT sequence.")
    return provider


def device_calibration(provider: VrsDataProvider, path: Path) -> DeviceCalibration:
    """The factory calibration of a device that has an RGB camera.

    Raises:
        UserError: the file has none.
    """
    device = provider.get_device_calibration()
    if device is None or device.get_camera_calib(RGB_LABEL) is None:
        raise UserError(
            f"{path}: has no calibration of {RGB_LABEL}. It must be the video.vrs of an ADT sequence."
        )
    return device


def rectification(device: DeviceCalibration, camera: Camera, upright: bool, path: Path) -> Rectification:
    """What takes the RGB camera's pictures, and the labels of their pixels, to a pinhole camera.

    Args:
        device: see ``device_calibration``.
        camera: from ``rectify.pinhole``.
        upright: whether the result is turned upright, as the device's own calibration tells.
        path: the recording's file, for messages.

    Raises:
        UserError: it is to be turned, and the calibration does not tell how.
    """
    turns = clockwise_turns(device, RGB_LABEL) if upright else 0
    if turns is None:
        version = device.get_device_version().name
        raise UserError(
            f"{path}: its calibration is of no Aria that is known (version {version}), and which side of its pictures "
            "is up is not told. Set frames.upright=false to take them as they are."
        )
    return Rectification(device.get_camera_calib(RGB_LABEL), camera, turns)

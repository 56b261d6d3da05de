"""Read the frames of Aria Digital Twin (ADT) recordings.

Of a sequence only ``video.vrs`` (``recording.vrs`` of other Aria glasses), and ``metadata.json`` for the origin, are read (docs/method.md#adt-files).
"""

import os
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
from egosplat.frames.files import ADT_VIDEOS, adt_video
from egosplat.frames.native_log import captured_log, find_damage, log_messages
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import Capture
from egosplat.frames.rectify import Rectification, clockwise_turns, pinhole
from egosplat.frames.selection import select_frames
from egosplat.frames.vrs import open_checked
from egosplat.geometry import Camera
from egosplat.pipeline.recording_origin import recording_origin

RGB_LABEL = "camera-rgb"
RGB_STREAM = StreamId("214-1")
# Half of the rolling shutter's readout (docs/method.md#exposure-time).
EXPOSURE_MIDDLE_AFTER_CAPTURE_NS = 2_500_000


class AdtRecording:
    """The RGB frames of an ADT sequence folder; a ``Recording``."""

    def __init__(self, folder: Path, options: FramesOptions) -> None:
        """Open ``video.vrs`` and select frames; UserError if it is missing or damaged, or no frame is selected."""
        camera, upright = pinhole(options.resolution, options.focal), options.upright
        self._path = adt_video(folder)
        self._provider = open_video(folder)
        timestamps = np.array(
            self._provider.get_timestamps_ns(RGB_STREAM, TimeDomain.DEVICE_TIME), dtype=np.int64
        )
        if not len(timestamps):
            raise UserError(f"{self._path}: has no RGB frame. Download it again.")
        self._frames = select_frames(timestamps, options, self._path)
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

    def read_frames(self, indices: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        """See ``Recording.read_frames``; UserError if a frame cannot be decoded or is black."""
        for index in indices:
            fisheye = self._decode(int(self._frames[index]))
            try:
                image = self._rectification.color(fisheye)
            except ValueError as error:
                raise UserError(f"{self._path}: RGB frame {self._frames[index]}: {error}.") from error
            if not image.any():
                raise UserError(
                    f"{self._path}: RGB frame {self._frames[index]} is black. Exclude it with start_s and end_s."
                )
            yield image

    def _decode(self, frame: int) -> NDArray[np.uint8]:
        try:
            with captured_log() as messages:
                data, _ = self._provider.get_image_data_by_index(RGB_STREAM, frame)
                image = data.to_numpy_array() if data.is_valid() else None
        except RuntimeError as error:
            image, messages = None, [*messages, str(error)]
        # The library returns a damaged JPEG partly decoded and only logs a line about it.
        reason = find_damage(messages)
        if image is None or image.ndim != 3 or reason:
            reason = reason or "; ".join(messages) or "not a color image"
            raise UserError(
                f"{self._path}: RGB frame {frame} cannot be decoded ({reason}). Download it again."
            )
        log_messages(messages, self._path)
        return image


open_recording = AdtRecording


def open_video(folder: Path) -> VrsDataProvider:
    """Open ``video.vrs`` of a sequence; UserError if it is missing, damaged, incomplete, or has no RGB stream."""
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder. Give the folder of a sequence, not a file in it.")
    path = adt_video(folder)
    if not os.path.lexists(path):
        raise UserError(f"{folder}: has no {' or '.join(ADT_VIDEOS)}. Download this file of the recording.")
    provider = open_checked(path, lambda: data_provider.create_vrs_data_provider(str(path)))
    if not provider.check_stream_is_active(RGB_STREAM):
        raise UserError(
            f"{path}: has no RGB stream (214-1). Give a recording of Aria glasses with its color camera."
        )
    return provider


def device_calibration(provider: VrsDataProvider, path: Path) -> DeviceCalibration:
    """The factory calibration of the device; UserError if the file has none of the RGB camera."""
    device = provider.get_device_calibration()
    if device is None or device.get_camera_calib(RGB_LABEL) is None:
        raise UserError(
            f"{path}: has no calibration of {RGB_LABEL}. Give a recording of Aria glasses with its color camera."
        )
    return device


def rectification(device: DeviceCalibration, camera: Camera, upright: bool, path: Path) -> Rectification:
    """Rectification of frames and label maps to a ``rectify.pinhole``; UserError if upright is asked for and not known."""
    turns = clockwise_turns(device, RGB_LABEL) if upright else 0
    if turns is None:
        version = device.get_device_version().name
        raise UserError(
            f"{path}: the calibration is of an unknown Aria (version {version}), so the upright direction is "
            "unknown. Set frames.upright=false to keep the frames as they are."
        )
    return Rectification(device.get_camera_calib(RGB_LABEL), camera, turns)

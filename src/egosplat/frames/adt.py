"""Import recordings of Aria Digital Twin (ADT) and other Aria glasses.

Of a sequence only ``video.vrs`` (``recording.vrs`` of other Aria glasses), and ``metadata.json`` for the origin, are read (docs/method.md#adt-files).
"""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from projectaria_tools.core import data_provider
from projectaria_tools.core.calibration import DeviceCalibration
from projectaria_tools.core.data_provider import VrsDataProvider
from projectaria_tools.core.sensor_data import TimeDomain
from projectaria_tools.core.stream_id import StreamId

from egosplat.calibration.files import ADT_VIDEOS, adt_video, recording_origin
from egosplat.errors import UserError
from egosplat.frames.native_log import captured_log, find_damage, log_messages
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import Recording
from egosplat.frames.rectify import Rectification, clockwise_turns, pinhole
from egosplat.frames.selection import select_frames
from egosplat.frames.vrs import check_complete
from egosplat.geometry import Camera

Provider = TypeVar("Provider")

RGB_LABEL = "camera-rgb"
RGB_STREAM = StreamId("214-1")
# Half of the rolling shutter's readout (docs/method.md#exposure-time).
EXPOSURE_MIDDLE_AFTER_CAPTURE_NS = 2_500_000

_DROPPED_RECORDS = "beyond the end of the file"


def open_recording(folder: Path, options: FramesOptions) -> Recording:
    """Open ``video.vrs`` and select frames; UserError if it is missing or damaged, or no frame is selected."""
    path, provider = adt_video(folder), open_video(folder)
    timestamps = np.array(provider.get_timestamps_ns(RGB_STREAM, TimeDomain.DEVICE_TIME), dtype=np.int64)
    if not len(timestamps):
        raise UserError(f"{path}: has no RGB frame. Download it again.")
    frames = select_frames(timestamps, options, path)
    device = device_calibration(provider, path)
    camera = pinhole(options.resolution, options.focal)
    rectified = rectification(device, camera, options.upright, path)

    def read_frames(indices: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        for frame in frames[indices].tolist():
            yield _read_frame(provider, path, frame, rectified)

    return Recording(
        timestamp_ns=timestamps[frames],
        exposure_middle_ns=timestamps[frames] + EXPOSURE_MIDDLE_AFTER_CAPTURE_NS,
        camera=rectified.camera,
        camera_known=True,
        valid=rectified.valid,
        read_frames=read_frames,
        device_from_camera=rectified.device_from_camera,
        origin=recording_origin("adt", folder),
        upright=options.upright or clockwise_turns(device, RGB_LABEL) == 0,
    )


def _read_frame(
    provider: VrsDataProvider, path: Path, frame: int, rectified: Rectification
) -> NDArray[np.uint8]:
    """Decode and rectify a frame; UserError if it cannot be decoded or is black."""
    try:
        color = rectified.color(_decode(provider, path, frame))
    except ValueError as error:
        raise UserError(f"{path}: RGB frame {frame}: {error}.") from error
    if not color.any():
        raise UserError(f"{path}: RGB frame {frame} is black. Exclude it with start_s and end_s.")
    return color


def _decode(provider: VrsDataProvider, path: Path, frame: int) -> NDArray[np.uint8]:
    image, messages = None, []
    try:
        with captured_log() as messages:
            data, _ = provider.get_image_data_by_index(RGB_STREAM, frame)
            image = data.to_numpy_array() if data.is_valid() else None
    except RuntimeError as error:
        messages = [*messages, str(error)]
    # The library returns a damaged JPEG partly decoded and only logs a line about it.
    reason = find_damage(messages)
    if image is None or image.ndim != 3 or reason:
        reason = reason or "; ".join(messages) or "not a color image"
        raise UserError(f"{path}: RGB frame {frame} cannot be decoded ({reason}). Download it again.")
    log_messages(messages, path)
    return image


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


def open_checked(path: Path, opened: Callable[[], Provider | None]) -> Provider:
    """Open a VRS file by a function of projectaria-tools; UserError if it is missing, damaged or truncated."""
    check_complete(path)
    try:
        with captured_log() as messages:
            provider = opened()
    except RuntimeError as error:
        raise UserError(f"{path}: cannot be read ({error}). Download it again.") from error
    if provider is None:
        raise UserError(f"{path}: cannot be read ({'; '.join(messages)}). Download it again.")
    if dropped := [message for message in messages if _DROPPED_RECORDS in message]:
        raise UserError(f"{path}: truncated ({dropped[0]}). Download it again.")
    log_messages(messages, path)
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
        raise UserError(
            f"{path}: the calibration is of an unknown Aria (version {device.get_device_version().name}), so the upright "
            "direction is unknown. Set frames.upright=false to keep the frames as they are."
        )
    return Rectification(device.get_camera_calib(RGB_LABEL), camera, turns)

"""Import recordings of Aria Digital Twin (ADT) and other Aria glasses. Of a sequence only ``video.vrs`` (``recording.vrs`` of other
Aria glasses), and ``metadata.json`` for the origin, are read (docs/method.md#adt-files)."""

import os
import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from projectaria_tools.core.calibration import DeviceCalibration
from projectaria_tools.core.data_provider import VrsDataProvider, create_vrs_data_provider
from projectaria_tools.core.sensor_data import TimeDomain
from projectaria_tools.core.stream_id import StreamId

from egosplat.calibration.files import ADT_VIDEOS, adt_video, recording_origin
from egosplat.errors import UserError
from egosplat.frames.native_log import captured_log
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import Recording
from egosplat.frames.rectify import Rectification, clockwise_turns, pinhole
from egosplat.frames.selection import select_frames
from egosplat.geometry import Camera
from egosplat.progress import log

Read = TypeVar("Read")

RGB_LABEL = "camera-rgb"
RGB_STREAM = StreamId("214-1")
# Half of the rolling shutter's readout (docs/method.md#exposure-time).
EXPOSURE_MIDDLE_AFTER_CAPTURE_NS = 2_500_000

# What the library logs about a truncated file, and about damaged data.
_TRUNCATED = re.compile("beyond the end of the file|Index incomplete")
_DAMAGED = re.compile(
    r"\[ERROR\]|corrupt|premature end|unsupported marker|decompression error", re.IGNORECASE
)


def open_recording(folder: Path, options: FramesOptions) -> Recording:
    """Open ``video.vrs`` and select frames; UserError if it is missing or damaged, or no frame is selected."""
    path, provider = adt_video(folder), open_video(folder)
    timestamps = np.array(provider.get_timestamps_ns(RGB_STREAM, TimeDomain.DEVICE_TIME), dtype=np.int64)
    frames = select_frames(timestamps, options, path)
    device = provider.get_device_calibration()
    rectified = rectification(device, pinhole(options.resolution), options.upright, path)

    def read(frame: int) -> NDArray[Any]:
        data, _ = provider.get_image_data_by_index(RGB_STREAM, frame)
        if not data.is_valid() or (image := data.to_numpy_array()).ndim != 3:
            raise ValueError("not a color image")
        return rectified.color(image)

    def read_frames(indices: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
        for frame in frames[indices].tolist():
            image = read_checked(path, f"RGB frame {frame} ", partial(read, frame))
            if image is None or not image.any():
                raise UserError(
                    f"{path}: RGB frame {frame} is black. Exclude it with frames.start_s and frames.end_s."
                )
            yield image

    return Recording(
        timestamp_ns=timestamps[frames],
        exposure_middle_ns=timestamps[frames] + EXPOSURE_MIDDLE_AFTER_CAPTURE_NS,
        camera=rectified.camera,
        camera_known=True,
        valid=rectified.valid,
        read_frames=read_frames,
        device_from_camera=rectified.device_from_camera,
        origin=recording_origin("adt", folder),
        upright=options.upright or (device is not None and clockwise_turns(device, RGB_LABEL) == 0),
    )


def read_checked(
    path: Path, what: str, read: Callable[[], Read | None], faults: re.Pattern[str] = _DAMAGED
) -> Read | None:
    """Read ``what`` of a file by projectaria-tools; UserError if that fails or logs a fault, where it is not None."""
    value, messages, failure = None, [], []
    try:
        with captured_log() as messages:
            if (value := read()) is None:
                return None
    except (RuntimeError, ValueError) as error:
        failure = [str(error)]
    # The library goes on with what is left of damaged data, and only logs lines about it.
    told = [*messages, *failure]
    if reason := next(filter(faults.search, told), failure and "; ".join(told)):
        raise UserError(f"{path}: {what}cannot be read ({reason}). Download it again.")
    for message in dict.fromkeys(messages):
        log(f"{path}: {message}")
    return value


def open_video(folder: Path) -> VrsDataProvider:
    """Open ``video.vrs`` of a sequence; UserError if it is missing, damaged, incomplete, or has no RGB stream."""
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder. Give the folder of a sequence, not a file in it.")
    path = adt_video(folder)
    if not os.path.lexists(path):
        raise UserError(f"{folder}: has no {' or '.join(ADT_VIDEOS)}. Download this file of the recording.")
    provider = open_vrs(path, lambda: create_vrs_data_provider(str(path)))
    if not provider.check_stream_is_active(RGB_STREAM):
        raise UserError(f"{path}: has no RGB stream (214-1). Give a recording with the color camera.")
    return provider


def open_vrs(path: Path, create: Callable[[], Read | None]) -> Read:
    """Open a VRS file by a function of projectaria-tools; UserError if it is damaged or truncated."""
    path.open("rb").close()  # a library does not tell that it may not read a file
    provider = read_checked(path, "", create, _TRUNCATED)
    if provider is None:
        raise UserError(f"{path}: not a VRS file. Download it again.")
    return provider


def rectification(
    device: DeviceCalibration | None, camera: Camera, upright: bool, path: Path
) -> Rectification:
    """Rectification of frames and label maps to a ``rectify.pinhole``; UserError if upright is asked for and not known."""
    if device is None or (lens := device.get_camera_calib(RGB_LABEL)) is None:
        raise UserError(f"{path}: has no calibration of {RGB_LABEL}. Give a recording of Aria glasses.")
    turns = clockwise_turns(device, RGB_LABEL) if upright else 0
    if turns is None:
        version = device.get_device_version().name
        raise UserError(f"{path}: up is unknown for Aria {version}. Set frames.upright=false.")
    return Rectification(lens, camera, turns)

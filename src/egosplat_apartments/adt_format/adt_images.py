"""The five VRS files of an ADT sequence: RGB images, and labels and depth with and without people."""

import contextlib
import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from egosplat_apartments.adt_format.aria import DEVICE_SERIAL, calibration_json
from egosplat_apartments.adt_format.sequence import Frame, Sequence
from egosplat_apartments.adt_format.vrs import ImageStream, VrsWriter, create_vrs

RGB_STREAM = "214-1"
# Suffix of the files that show people; the files without it show the room without them.
WITH_PEOPLE = "_with_skeleton"

# VRS's pixel formats. ADT declares labels as 64-bit floats and reads them as 64-bit integers.
_GREY16, _SCALAR64F = 11, 13


@contextlib.contextmanager
def create_images(folder: Path, sequence: Sequence, jpeg_quality: int) -> Iterator["ImageFiles"]:
    """Write ``video.vrs``, ``segmentations*.vrs`` and ``depth_images*.vrs`` in one pass over the frames.

    Args:
        folder: an existing folder.
        sequence: only its name, size and frame rate are used here.
        jpeg_quality: of the RGB images, 1 to 95 (Pillow's scale). Labels and depth are stored losslessly.
    """
    calibration = calibration_json(sequence.size)
    configuration = {**_configuration(sequence), "factory_calibration": calibration}
    streams = {"video": ImageStream(214, 1, "RGB Camera Class", "device/aria", "jpg", False, configuration)}
    for suffix in ("", WITH_PEOPLE):
        streams[f"segmentations{suffix}"] = _truth_stream(
            sequence, 400, "Annotation Data Class", _SCALAR64F, 8
        )
        streams[f"depth_images{suffix}"] = _truth_stream(
            sequence, 345, "Ground Truth Depth Data Class", _GREY16, 2
        )
    with contextlib.ExitStack() as stack:
        files = {
            name: stack.enter_context(
                create_vrs(folder / f"{name}.vrs", _file_tags(sequence, name, calibration), stream)
            )
            for name, stream in streams.items()
        }
        yield ImageFiles(files, sequence.size, jpeg_quality)


class ImageFiles:
    """The open VRS files; made by ``create_images``."""

    def __init__(self, files: dict[str, VrsWriter], size: int, jpeg_quality: int) -> None:
        self._files = files
        self._size = size
        self._jpeg_quality = jpeg_quality

    def write(self, frame: Frame, number: int, truth_ns: int) -> None:
        """Append a frame: its RGB image at the capture time, its labels and depth at ``truth_ns``.

        Raises:
            ValueError: an image does not have the shape and dtype that ``Frame`` documents.
        """
        self._check("rgb", frame.rgb, np.uint8, (3,))
        encoded = io.BytesIO()
        Image.fromarray(frame.rgb).save(encoded, "JPEG", quality=self._jpeg_quality)
        self._append("video", frame, number, frame.capture_ns, encoded.getvalue())
        for suffix, view in (("", frame.without_people), (WITH_PEOPLE, frame.with_people)):
            self._check("segmentation", view.segmentation, np.uint64)
            self._check("depth_mm", view.depth_mm, np.uint16)
            labels, depth = view.segmentation.astype("<u8").tobytes(), view.depth_mm.astype("<u2").tobytes()
            self._append(f"segmentations{suffix}", frame, number, truth_ns, labels)
            self._append(f"depth_images{suffix}", frame, number, truth_ns, depth)

    def _append(self, name: str, frame: Frame, number: int, time_ns: int, image: bytes) -> None:
        exposed = {"exposure_s": frame.exposure_s, "gain": frame.gain}
        self._files[name].write_image(image, timestamp_ns=time_ns, frame_number=number, **exposed)

    def _check(self, name: str, image: NDArray[Any], dtype: type, channels: tuple[int, ...] = ()) -> None:
        expected = (self._size, self._size, *channels)
        if image.shape != expected or image.dtype != dtype:
            raise ValueError(
                f"{name}: {image.dtype} {image.shape} given, {np.dtype(dtype)} {expected} expected"
            )


def _truth_stream(
    sequence: Sequence, type_id: int, name: str, pixel_format: int, bytes_per_pixel: int
) -> ImageStream:
    """A stream of ground truth; its description names the camera that it belongs to."""
    configuration = {
        **_configuration(sequence),
        "image_stride": sequence.size * bytes_per_pixel,
        "image_pixel_format": pixel_format,
        "description": RGB_STREAM,
    }
    return ImageStream(type_id, 1, name, "rgbFlavor", "raw", True, configuration)


def _configuration(sequence: Sequence) -> dict[str, float | str]:
    return {
        "camera_id": 2,
        "nominal_rate": sequence.fps,
        "image_width": sequence.size,
        "image_height": sequence.size,
        "gamma_factor": 1.0,
        "device_type": "Aria",
        "device_serial": DEVICE_SERIAL,
        "sensor_model": "synthetic",
        "sensor_serial": DEVICE_SERIAL,
    }


def _file_tags(sequence: Sequence, name: str, calibration: str) -> dict[str, str]:
    metadata = {
        "filename": f"{name}.vrs",
        "recording_profile": "synthetic",
        "shared_session_id": sequence.name,
    }
    return {
        "calib_json": calibration,
        "device_serial": DEVICE_SERIAL,
        "device_type": "Aria",
        "metadata": json.dumps(metadata),
        "session_id": sequence.name,
    }

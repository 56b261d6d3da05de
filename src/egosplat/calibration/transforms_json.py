"""Read a nerfstudio ``transforms.json``: OpenGL camera axes, OpenCV distortion, an optional cloud of points."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.companions import points_path
from egosplat.calibration.contents import Contents
from egosplat.calibration.lens import Lens
from egosplat.calibration.ply import read_points
from egosplat.errors import UserError
from egosplat.files import read_json
from egosplat.geometry import is_rigid

_MODELS = ("PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE")
_INTRINSICS = (
    *("w", "h", "fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y"),
    *("k1", "k2", "k3", "k4", "p1", "p2"),
)
# Camera axes of OpenGL (x right, y up, z backward) to those of OpenCV.
_OPENGL = np.array([1.0, -1.0, -1.0, 1.0])


def read_transforms(path: Path, width: int, height: int) -> Contents:
    """Read the camera, the poses and the points.

    Args:
        width, height: size of the pictures [px], for files that do not name it.

    Raises:
        UserError: the file is damaged, lacks a key, or its camera is not supported.
    """
    document = _read_document(path)
    frames = document["frames"]
    names = [_name(frame, f"{path}: frames[{index}]") for index, frame in enumerate(frames)]
    poses = np.stack(
        [
            _matrix(frame.get("transform_matrix"), 4, f"{path}: {name}: transform_matrix")
            for name, frame in zip(names, frames, strict=True)
        ]
    )
    notes = _world_notes(document, path)
    points, colors = _points(document, path)
    return Contents(
        camera_file=str(path),
        pose_file=str(path),
        lens=_lens(document, names, path, width, height),
        names=names,
        camera_to_world=poses * _OPENGL,
        points=points,
        point_rgb=colors,
        point_views=np.zeros(len(points), np.int64),
        point_error_px=np.zeros(len(points)),
        notes=notes,
    )


def _read_document(path: Path) -> dict[str, Any]:
    try:
        document = read_json(path)
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: not readable as JSON ({error}).") from error
    frames = document.get("frames") if isinstance(document, dict) else None
    if not isinstance(frames, list) or not frames or not all(isinstance(frame, dict) for frame in frames):
        raise UserError(f"{path}: has no list 'frames' with an object for each picture.")
    return document


def _name(frame: Mapping[str, Any], where: str) -> str:
    name = frame.get("file_path")
    if not isinstance(name, str) or not name:
        raise UserError(f"{where}: file_path is not the name of a picture.")
    return name


def _matrix(value: Any, rows: int, where: str) -> NDArray[np.float64]:
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.empty(0)
    if matrix.shape != (rows, 4):
        raise UserError(f"{where} is not {rows} rows of 4 numbers.")
    return matrix


def _lens(document: dict[str, Any], names: list[str], path: Path, width: int, height: int) -> Lens:
    """The camera that all frames share."""
    # A frame may override the file's camera, as nerfstudio reads it.
    given = [_intrinsics(document | frame, path) for frame in document["frames"]]
    for name, one in zip(names, given, strict=True):
        if one != given[0]:
            raise UserError(
                f"{path}: {name} has another camera than {names[0]}, but all pictures must share one."
            )
    model, numbers = given[0]
    width, height = numbers.get("w", width), numbers.get("h", height)
    if width != int(width) or height != int(height):
        raise UserError(f"{path}: w and h are {width:g} and {height:g}, not whole numbers of pixels.")
    fx, fy = _focal_lengths(numbers, width, height, path)
    pinhole = (fx, fy, numbers.get("cx", width / 2), numbers.get("cy", height / 2))
    k1, k2, k3, k4, p1, p2 = (numbers.get(key, 0.0) for key in ("k1", "k2", "k3", "k4", "p1", "p2"))
    if model == "OPENCV_FISHEYE":
        return Lens(model, int(width), int(height), (*pinhole, k1, k2, k3, k4))
    if k4:
        raise UserError(
            f"{path}: k4 is not supported for camera_model {model}; use OPENCV_FISHEYE or k1 to k3."
        )
    if k3:
        return Lens("FULL_OPENCV", int(width), int(height), (*pinhole, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0))
    return Lens("OPENCV", int(width), int(height), (*pinhole, k1, k2, p1, p2))


def _intrinsics(entries: Mapping[str, Any], path: Path) -> tuple[str, dict[str, float]]:
    """The name of the camera model and the numbers of a camera."""
    # instant-ngp marks a fisheye lens by a key of its own.
    model = entries.get("camera_model", "OPENCV_FISHEYE" if entries.get("is_fisheye") else "OPENCV")
    if model not in _MODELS:
        raise UserError(
            f"{path}: camera_model {str(model)[:40]} is not supported. Supported: {', '.join(_MODELS)}."
        )
    numbers = {}
    for key in _INTRINSICS:
        if key in entries:
            value = entries[key]
            if isinstance(value, bool) or not isinstance(value, int | float) or not _is_finite(value):
                raise UserError(f"{path}: {key} is {str(value)[:40]}, not a finite number.")
            numbers[key] = float(value)
    return model, numbers


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _focal_lengths(
    numbers: Mapping[str, float], width: float, height: float, path: Path
) -> tuple[float, float]:
    if "fl_x" in numbers:
        return numbers["fl_x"], numbers.get("fl_y", numbers["fl_x"])
    angle_x = numbers.get("camera_angle_x", 0.0)
    if not 0 < angle_x < math.pi:
        raise UserError(f"{path}: has neither fl_x nor camera_angle_x, so the focal length is not known.")
    fx = width / (2 * math.tan(angle_x / 2))
    angle_y = numbers.get("camera_angle_y", 0.0)
    return fx, (height / (2 * math.tan(angle_y / 2)) if 0 < angle_y < math.pi else fx)


def _world_notes(document: dict[str, Any], path: Path) -> dict[str, Any]:
    """What the file says about its world: the rotation and the scale that nerfstudio applied."""
    notes: dict[str, Any] = {}
    if "applied_transform" in document:
        applied = _matrix(document["applied_transform"], 3, f"{path}: applied_transform")
        if not is_rigid(np.vstack([applied, [0.0, 0.0, 0.0, 1.0]])):
            raise UserError(f"{path}: applied_transform is not a rotation and a translation.")
        notes["applied_transform"] = applied.tolist()
    if "applied_scale" in document:
        scale = document["applied_scale"]
        if (
            isinstance(scale, bool)
            or not isinstance(scale, int | float)
            or not (_is_finite(scale) and scale > 0)
        ):
            raise UserError(f"{path}: applied_scale is {str(scale)[:40]}, not a positive number.")
        notes["applied_scale"] = float(scale)
    return notes


def _points(document: dict[str, Any], path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    file = points_path(path, document)
    if file is not None:
        return read_points(file)
    if document.get("ply_file_path") is not None:
        raise UserError(f"{path}: ply_file_path is not the name of a file.")
    return np.empty((0, 3)), np.empty((0, 3), np.uint8)

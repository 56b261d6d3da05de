"""Read a ``transforms.json`` of nerfstudio or instant-ngp: OpenGL camera axes, a camera for all or each, points, masks."""

import math
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.contents import Contents
from egosplat.calibration.files import points_path
from egosplat.calibration.lens import Lens
from egosplat.calibration.ply import read_points
from egosplat.errors import UserError
from egosplat.files import read_json
from egosplat.geometry import ARIA_PIXEL_OFFSET, OPENGL_AXES, is_rigid

_PERSPECTIVE = ("PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
_FISHEYE, _ARIA = "OPENCV_FISHEYE", "FISHEYE624"
_MODELS = (*_PERSPECTIVE, _FISHEYE, _ARIA)

# nerfstudio's order of ``distortion_params``; Aria's has twelve, in COLMAP's order.
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")
_PARAMETERS = {_ARIA: 12}
# The keys of a camera, of the file or of a frame. instant-ngp has fields of view in degrees, others angles in radians.
_NUMBERS = (
    *("w", "h", "fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y", "x_fov", "y_fov"),
    *("fisheye_crop_radius", *_DISTORTION),
)
_CAMERA = ("camera_model", "is_fisheye", "distortion_params", *_NUMBERS)
_READ = ("frames", "applied_transform", "applied_scale", "ply_file_path")
_READ_OF_FRAME = ("file_path", "transform_matrix", "mask_path")
# What changes the meaning of pixels or poses and is not read; a number of 0 or false changes nothing.
_REFUSED = (
    *("transform_matrix_start", "transform_matrix_end", "from_mitsuba"),
    *("latlong", "equirectangular", "orthographic"),
    *("ftheta_p0", "ftheta_p1", "ftheta_p2", "ftheta_p3", "ftheta_p4", "k5", "k6", "omega", "skew"),
)
# pycolmap counts pixels in 32 bits.
_MAX_SIDE = 2**31

Entries = Mapping[str, Any]


def read_transforms(path: Path, width: int, height: int) -> Contents:
    """Read the cameras, the poses and the points.

    Args:
        width, height: size of the pictures [px], for files that do not name it.

    Raises:
        UserError: the file is damaged, lacks a key, or has one that is not supported.
    """
    document = _read_document(path)
    frames = document["frames"]
    names = [_name(frame, f"{path}: frames[{index}]") for index, frame in enumerate(frames)]
    named = [(f"{path}: {name}", frame) for name, frame in zip(names, frames, strict=True)]
    poses = [_pose(frame.get("transform_matrix"), f"{where}: transform_matrix") for where, frame in named]
    for where, entries in ((str(path), document), *named):
        if refused := next((key for key in _REFUSED if entries.get(key)), None):
            raise UserError(
                f"{where}: {refused} is not supported: render or undistort to a plain camera, then remove it."
            )
    cameras = [_lens(_merged(document, frame, where), where, width, height) for where, frame in named]
    lenses = list(dict.fromkeys(cameras))
    notes = _world_notes(document, path)
    points, colors = _points(document, path)
    unread = [key for key in document if key not in (*_CAMERA, *_READ, *_REFUSED)]
    of_frame = (*_CAMERA, *_READ_OF_FRAME, *_REFUSED)
    unread += [key for frame in frames for key in frame if key not in of_frame]
    return Contents(
        camera_file=str(path),
        pose_file=str(path),
        lenses=lenses,
        lens_of=np.array([lenses.index(camera) for camera in cameras], np.int64),
        names=names,
        camera_to_world=np.stack(poses) * OPENGL_AXES,
        points=points,
        point_rgb=colors,
        point_views=np.zeros(len(points), np.int64),
        point_error_px=np.zeros(len(points)),
        masks=_masks(document, path),
        unread=list(dict.fromkeys(unread)),
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


def _name(frame: Entries, where: str) -> str:
    name = frame.get("file_path")
    if not isinstance(name, str) or not name:
        raise UserError(f"{where}: file_path is not the name of a picture.")
    return name


def _pose(value: Any, where: str) -> NDArray[np.float64]:
    """(4, 4) pose; a matrix of three rows gets the last one."""
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.empty(0)
    if matrix.shape not in ((3, 4), (4, 4)):
        raise UserError(f"{where} is not 4 rows of 4 numbers.")
    return matrix if len(matrix) == 4 else np.vstack([matrix, [0.0, 0.0, 0.0, 1.0]])


def _masks(document: Entries, path: Path) -> list[Path | None]:
    """The mask of each frame; none if no frame has one."""
    names = [frame.get("mask_path") for frame in document["frames"]]
    for name in names:
        if name is not None and not (isinstance(name, str) and name and os.path.isfile(path.parent / name)):
            raise UserError(f"{path}: mask_path {str(name)[:200]} is not the name of a picture beside it.")
    return [None if name is None else path.parent / name for name in names] if any(names) else []


def _merged(document: Entries, frame: Entries, where: str) -> dict[str, Any]:
    """The keys of a frame's camera: of the file, or of the frame."""
    own = {key: frame[key] for key in _CAMERA if key in frame}
    shared = {key: document[key] for key in _CAMERA if key in document}
    for key in own.keys() & shared.keys():
        # nerfstudio takes the file's, instant-ngp the frame's.
        if own[key] != shared[key]:
            raise UserError(f"{where}: {key} differs from that of the whole file; remove one of the two.")
    return shared | own


def _lens(entries: Entries, where: str, width: int, height: int) -> Lens:
    """The camera of a frame."""
    # instant-ngp marks a fisheye lens by a key of its own.
    model = entries.get("camera_model", _FISHEYE if entries.get("is_fisheye") else "OPENCV")
    if model not in _MODELS:
        raise UserError(
            f"{where}: camera_model {str(model)[:40]} is not supported. Supported: {', '.join(_MODELS)}."
        )
    numbers = {key: _number(entries[key], key, where) for key in _NUMBERS if key in entries}
    w, h = numbers.get("w", width), numbers.get("h", height)
    if not (1 <= w == int(w) < _MAX_SIDE and 1 <= h == int(h) < _MAX_SIDE):
        raise UserError(f"{where}: w and h are {w:g} and {h:g}, not whole numbers of pixels.")
    fx, fy = _focal_length(numbers, "x", w), _focal_length(numbers, "y", h)
    given = [focal for focal in (fx, fy) if focal is not None]
    if not given:
        raise UserError(f"{where}: has neither fl_x nor camera_angle_x, so the focal length is not known.")
    pinhole = (given[0], given[-1], numbers.get("cx", w / 2), numbers.get("cy", h / 2))
    distortion = _distortion(entries, numbers, model, where)
    radius = None if model in _PERSPECTIVE else numbers.get("fisheye_crop_radius")
    name, params = _in_colmap_order(model, pinhole, distortion, where)
    return Lens(name, int(w), int(h), params, radius)


def _in_colmap_order(
    model: str, pinhole: tuple[float, ...], distortion: list[float], where: str
) -> tuple[str, tuple[float, ...]]:
    """Model and parameters as COLMAP has them."""
    if model == _ARIA:
        # Aria's principal point counts from the center of the first pixel.
        fx, fy, cx, cy = pinhole
        center = (cx + ARIA_PIXEL_OFFSET, cy + ARIA_PIXEL_OFFSET)
        return "RAD_TAN_THIN_PRISM_FISHEYE", (fx, fy, *center, *distortion)
    k1, k2, k3, k4, p1, p2 = distortion
    if model == _FISHEYE:
        if p1 or p2:
            raise UserError(f"{where}: p1 and p2 are not supported for camera_model {model}.")
        return model, (*pinhole, k1, k2, k3, k4)
    if k4:
        raise UserError(
            f"{where}: k4 is not supported for camera_model {model}; use OPENCV_FISHEYE or k1 to k3."
        )
    if k3:
        return "FULL_OPENCV", (*pinhole, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0)
    return "OPENCV", (*pinhole, k1, k2, p1, p2)


def _distortion(entries: Entries, numbers: Mapping[str, float], model: str, where: str) -> list[float]:
    """The distortion in the order of ``distortion_params``."""
    single = [numbers.get(key, 0.0) for key in _DISTORTION]
    count, given = _PARAMETERS.get(model, len(_DISTORTION)), entries.get("distortion_params")
    if given is None and count == len(single):
        return single
    if not isinstance(given, list) or len(given) != count:
        raise UserError(f"{where}: distortion_params is not a list of {count} numbers, as {model} has.")
    values = [_number(value, "distortion_params", where) for value in given]
    if any(single) and values != single:
        raise UserError(
            f"{where}: has distortion_params and {', '.join(_DISTORTION)}; remove one of the two."
        )
    return values


def _number(value: Any, key: str, where: str) -> float:
    # math.isfinite refuses whole numbers that are too large for a float.
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
        raise UserError(f"{where}: {key} is {str(value)[:40]}, not a finite number.")
    return float(value)


def _focal_length(numbers: Mapping[str, float], axis: str, side: float) -> float | None:
    """The focal length [px] along an axis, given as it is or by the angle of view; None without either."""
    if f"fl_{axis}" in numbers:
        return numbers[f"fl_{axis}"]
    angle = numbers.get(f"camera_angle_{axis}", math.radians(numbers.get(f"{axis}_fov", 0.0)))
    return side / (2 * math.tan(angle / 2)) if 0 < angle < math.pi else None


def _world_notes(document: Entries, path: Path) -> dict[str, Any]:
    """What the file says about its world: the rotation and the scale that nerfstudio applied."""
    notes: dict[str, Any] = {}
    if "applied_transform" in document:
        applied = _pose(document["applied_transform"], f"{path}: applied_transform")
        if not is_rigid(applied):
            raise UserError(f"{path}: applied_transform is not a rotation and a translation.")
        notes["applied_transform"] = applied[:3].tolist()
    if "applied_scale" in document:
        notes["applied_scale"] = scale = _number(document["applied_scale"], "applied_scale", str(path))
        if scale <= 0:
            raise UserError(f"{path}: applied_scale is {scale:g}, not a positive number.")
    return notes


def _points(document: Entries, path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    if file := points_path(path, document):
        return read_points(file)
    if document.get("ply_file_path") is not None:
        raise UserError(f"{path}: ply_file_path is not the name of a file.")
    return np.empty((0, 3)), np.empty((0, 3), np.uint8)

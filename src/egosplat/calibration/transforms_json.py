"""Read a ``transforms.json`` of nerfstudio or instant-ngp: OpenGL camera axes, a camera for all or each, points, masks."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from egosplat.calibration.colmap_model import Contents
from egosplat.calibration.files import named_path
from egosplat.calibration.lens import Lens
from egosplat.calibration.ply import read_points
from egosplat.errors import UserError
from egosplat.files import read_users_json
from egosplat.geometry import OPENGL_AXES, is_rigid

_FISHEYE = "OPENCV_FISHEYE"
# nerfstudio's order of ``distortion_params``.
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")
# The keys of a camera, of the file or of a frame. instant-ngp has fields of view in degrees, others angles in radians.
_NUMBERS = ("fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y", "x_fov", "y_fov", *_DISTORTION)
_CAMERA = ("w", "h", "camera_model", "is_fisheye", "distortion_params", *_NUMBERS)
# What changes the meaning of pixels or poses and is not read; a number of 0 or false changes nothing.
_REFUSED = (
    *("transform_matrix_start", "transform_matrix_end", "from_mitsuba", "latlong", "equirectangular"),
    *("orthographic", "fisheye_crop_radius", "k5", "k6", "omega", "skew"),
    *(f"ftheta_p{index}" for index in range(5)),
)

Some = TypeVar("Some", bound=BaseModel)
_Model = Literal["PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE"]
# JSON's true and "30" are no numbers.
_Number = Annotated[float, Field(strict=True)]
_Name = Annotated[str, Field(min_length=1)]
_Row = Annotated[list[_Number], Field(min_length=4, max_length=4)]
_Matrix = Annotated[list[_Row], Field(min_length=3, max_length=4)]
# pycolmap counts pixels in 32 bits.
_Side = Annotated[float, Field(strict=True, ge=1, lt=2**31, multiple_of=1)]


class _Document(BaseModel):
    model_config = ConfigDict(extra="allow", allow_inf_nan=False)

    frames: Annotated[list[dict[str, Any]], Field(min_length=1)]
    applied_transform: _Matrix | None = None
    applied_scale: Annotated[_Number, Field(gt=0)] | None = None
    ply_file_path: str | None = None


class _View(BaseModel):
    """A frame, with the keys of its camera."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False)

    file_path: _Name
    transform_matrix: _Matrix
    mask_path: _Name | None = None
    w: _Side
    h: _Side
    camera_model: _Model = "OPENCV"
    distortion_params: Annotated[list[_Number], Field(min_length=6, max_length=6)] | None = None
    numbers: dict[str, _Number]


def read_transforms(path: Path, width: int, height: int) -> Contents:
    """Read the cameras, the poses and the points; UserError if the file is damaged, or has a key that is not
    supported. ``width`` and ``height`` are those of the pictures [px], for files that do not name them."""
    content = read_users_json(path)
    document = _checked(_Document, content if isinstance(content, dict) else {}, str(path))
    of_file, size = document.model_extra or {}, {"w": width, "h": height}
    views = [
        _view(frame, of_file, size, f"{path}: frames[{index}]") for index, frame in enumerate(document.frames)
    ]
    points, colors = np.empty((0, 3)), np.empty((0, 3), np.uint8)
    if document.ply_file_path is not None:
        if not (cloud := named_path(path.parent, document.ply_file_path)).is_file():
            raise UserError(f"{path}: ply_file_path: no file {cloud}. Remove the key to triangulate points.")
        points, colors = read_points(cloud)
    notes: dict[str, Any] = {}
    if document.applied_transform:
        notes["applied_transform"] = applied = document.applied_transform[:3]
        if not is_rigid(np.array([*applied, [0.0, 0.0, 0.0, 1.0]])):
            raise UserError(f"{path}: applied_transform is not a rotation and a translation.")
    if document.applied_scale:
        notes["applied_scale"] = document.applied_scale
    poses = np.array([[*view.transform_matrix, [0.0, 0.0, 0.0, 1.0]][:4] for view in views])
    given = dict.fromkeys(key for entries in (of_file, *document.frames) for key in entries)
    return Contents(
        cameras=[_lens(view, f"{path}: {view.file_path}") for view in views],
        names=[view.file_path for view in views],
        camera_to_world=poses * OPENGL_AXES,
        points=points,
        point_rgb=colors,
        point_views=np.zeros(len(points), np.int64),
        point_error_px=np.zeros(len(points)),
        masks=[named_path(path.parent, view.mask_path) if view.mask_path else None for view in views],
        unread=[key for key in given if key not in (*_CAMERA, *_REFUSED, *_View.model_fields)],
        notes=notes,
    )


def _checked(model: type[Some], entries: Any, where: str) -> Some:
    try:
        return model.model_validate(entries)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(step) for step in first["loc"] if step != "numbers")
        given = f", not the text {first['input']!r:.40}" if isinstance(first["input"], str) else ""
        raise UserError(f"{where}: {key}: {first['msg']}{given}.") from error


def _view(frame: dict[str, Any], of_file: dict[str, Any], size: dict[str, int], where: str) -> _View:
    """A frame, with the keys of its camera: of the file, or of the frame."""
    where = f"{where}, {str(frame.get('file_path'))[:200]}"
    for key in _CAMERA:
        # nerfstudio takes the file's, instant-ngp the frame's.
        if key in frame and key in of_file and frame[key] != of_file[key]:
            raise UserError(f"{where}: {key} differs from that of the whole file; remove one of the two.")
    entries = size | of_file | frame
    if refused := next((key for key in _REFUSED if entries.get(key)), None):
        advice = "render or undistort to a plain camera, then remove it"
        raise UserError(f"{where}: {refused} is not supported: {advice}.")
    # instant-ngp marks a fisheye lens by a key of its own.
    model = {"camera_model": _FISHEYE} if entries.get("is_fisheye") else {}
    numbers = {key: entries[key] for key in _NUMBERS if key in entries}
    return _checked(_View, model | entries | {"numbers": numbers}, where)


def _lens(view: _View, where: str) -> Lens:
    """The camera of a frame as COLMAP has it."""
    numbers, width, height, model = view.numbers, int(view.w), int(view.h), view.camera_model
    focal = [_focal_length(numbers, *side, where) for side in (("x", width), ("y", height))]
    given = [each for each in focal if each is not None]
    if not given:
        raise UserError(f"{where}: has neither fl_x nor camera_angle_x, so the focal length is not known.")
    pinhole = (given[0], given[-1], numbers.get("cx", width / 2), numbers.get("cy", height / 2))
    single = [numbers.get(key, 0.0) for key in _DISTORTION]
    k1, k2, k3, k4, p1, p2 = values = view.distortion_params or single
    if any(single) and values != single:
        raise UserError(f"{where}: distortion_params differs from k1 to p2; remove one of the two.")
    if (p1 or p2) if model == _FISHEYE else k4:
        own = "k1 to k4" if model == _FISHEYE else "k1 to k3, p1, p2"
        raise UserError(f"{where}: camera_model {model} has {own} alone.")
    if model == _FISHEYE:
        return Lens(model, width, height, (*pinhole, k1, k2, k3, k4))
    if k3:
        return Lens("FULL_OPENCV", width, height, (*pinhole, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0))
    return Lens("OPENCV", width, height, (*pinhole, k1, k2, p1, p2))


def _focal_length(numbers: dict[str, float], axis: str, side: int, where: str) -> float | None:
    """The focal length [px] along an axis, given as it is or by the angle of view; None without either, UserError for no such angle."""
    if f"fl_{axis}" in numbers:
        return numbers[f"fl_{axis}"]
    for key, most in ((f"camera_angle_{axis}", math.pi), (f"{axis}_fov", 180.0)):
        if angle := numbers.get(key):
            if not 0 < angle < most:
                unit = "radians" if most == math.pi else "degrees"
                raise UserError(f"{where}: {key} is {angle:g}, not 0 to {most:.3g} {unit}.")
            return side / (2 * math.tan(angle / most * math.pi / 2))
    return None

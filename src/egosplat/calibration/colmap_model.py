"""Read a COLMAP model folder: ``cameras``, ``images`` and ``points3D``, all as .bin or all as .txt."""

import re
import struct
import tempfile
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from egosplat.calibration.companions import MODEL_FILES, MODEL_SUFFIXES, model_files, text_names
from egosplat.calibration.contents import Contents
from egosplat.calibration.lens import Lens
from egosplat.errors import UserError
from egosplat.geometry import invert, make_pose

# A word of a line; a picture's name has an extension.
_NOT_FINITE = re.compile(rb"(?<!\S)[-+]?(nan|inf|infinity)(?!\S)", re.IGNORECASE)

# A quaternion that was written with few digits.
_MAX_LENGTH_ERROR = 1e-3


def read_model(folder: Path) -> Contents:
    """Read the cameras, the poses and the points of a model; UserError if a file is missing or damaged."""
    suffix = _suffix(folder)
    model = _read(folder, suffix)
    images = sorted(
        (image for image in model.images.values() if image.has_pose), key=lambda image: image.name
    )
    if not images:
        raise UserError(f"{folder}: has no image with a pose.")
    found = [model.cameras[image.camera_id] for image in images]
    cameras = [Lens(one.model_name, one.width, one.height, tuple(map(float, one.params))) for one in found]
    lenses = list(dict.fromkeys(cameras))
    world_to_camera = np.stack([_world_to_camera(image) for image in images])
    points = [point for _, point in sorted(model.points3D.items())]
    return Contents(
        camera_file=str(folder / f"cameras{suffix}"),
        pose_file=str(folder / f"images{suffix}"),
        lenses=lenses,
        lens_of=np.array([lenses.index(camera) for camera in cameras], np.int64),
        names=[image.name for image in images],
        camera_to_world=invert(make_pose(world_to_camera[:, :, :3], world_to_camera[:, :, 3])),
        points=np.array([point.xyz for point in points], np.float64).reshape(-1, 3),
        point_rgb=np.array([point.color for point in points], np.uint8).reshape(-1, 3),
        point_views=np.array([point.track.length() for point in points], np.int64),
        point_error_px=np.array([max(point.error, 0.0) for point in points], np.float64),
    )


def _world_to_camera(image: pycolmap.Image) -> NDArray[np.float64]:
    """The (3, 4) matrix of an image, which is no rotation if its quaternion has another length than 1."""
    motion = image.cam_from_world()
    matrix, length = motion.matrix(), np.linalg.norm(motion.rotation.quat)
    # pycolmap takes a quaternion of zeros, or of a scale alone, for no rotation.
    return matrix if abs(length - 1) < _MAX_LENGTH_ERROR else matrix * [length, length, length, 1.0]


def _suffix(folder: Path) -> str:
    """The extension of the model's three files; UserError if one is missing in both formats."""
    files = model_files(folder)
    if len(files) == len(MODEL_FILES):
        return files[0].suffix
    suffix = files[0].suffix if files else MODEL_SUFFIXES[0]
    missing = [f"{name}{suffix}" for name in MODEL_FILES if folder / f"{name}{suffix}" not in files]
    raise UserError(
        f"{folder}: has no {', '.join(missing)}. A COLMAP model has cameras, images and points3D, all .bin or all .txt."
    )


def _read(folder: Path, suffix: str) -> pycolmap.Reconstruction:
    for name in MODEL_FILES:
        (_check_whole if suffix == ".bin" else _check_finite)(folder / f"{name}{suffix}")
    # COLMAP reads every file that it finds; here the three that are checked.
    with tempfile.TemporaryDirectory(prefix="egosplat-model-") as scratch:
        for name in MODEL_FILES:
            (Path(scratch) / f"{name}{suffix}").symlink_to((folder / f"{name}{suffix}").absolute())
        try:
            model = pycolmap.Reconstruction(scratch)
        except (ValueError, IndexError, RuntimeError, OSError) as error:
            reason = str(error).replace(f"{scratch}/", "").partition("\n")[0][-200:]
            raise UserError(f"{folder}: not a readable COLMAP model ({reason}). Export it again.") from error
    if suffix == ".txt":
        _check_names(folder / "images.txt")
    return model


def _check_names(path: Path) -> None:
    """Raise UserError if a name has a space: COLMAP reads it to the first one."""
    if broken := next((name for name in text_names(path) if " " in name), None):
        raise UserError(
            f"{path}: {broken}: the text format holds no names with spaces. Export the model as .bin."
        )


def _check_finite(path: Path) -> None:
    """Raise UserError unless a text file has finite numbers: COLMAP tells neither the file nor the line of another one."""
    content = path.read_bytes()
    for found in _NOT_FINITE.finditer(content):
        begin = content.rfind(b"\n", 0, found.start()) + 1
        # COLMAP writes means into comments, which are not finite if there is nothing to average.
        if content[begin : begin + 1] != b"#":
            line = content.count(b"\n", 0, begin) + 1
            raise UserError(
                f"{path}: line {line}: {found[0].decode()} is no finite number. Export the "
                "model again, or leave out what the line describes."
            )


def _check_whole(path: Path) -> None:
    """Raise UserError unless a binary file ends where its last record ends: COLMAP would wait or invent values."""
    content = path.read_bytes()
    skip = {"cameras": _skip_camera, "images": _skip_image, "points3D": _skip_point}[path.stem]
    try:
        (count,) = struct.unpack_from("<Q", content)
        position = 8
        for _ in range(count):
            position = skip(content, position)
            if position > len(content):
                break
        whole = position == len(content)
    except (struct.error, ValueError, KeyError):
        whole = False
    if not whole:
        raise UserError(f"{path}: damaged or incomplete ({len(content)} bytes). Copy it again.")


def _skip_camera(content: bytes, position: int) -> int:
    _, model, _, _ = struct.unpack_from("<iiQQ", content, position)
    return position + 24 + 8 * _PARAMETERS[model]


def _skip_image(content: bytes, position: int) -> int:
    end = content.index(b"\0", position + 64)
    (points,) = struct.unpack_from("<Q", content, end + 1)
    return end + 9 + 24 * points


def _skip_point(content: bytes, position: int) -> int:
    (length,) = struct.unpack_from("<Q", content, position + 43)
    return position + 51 + 8 * length


# Number of parameters of each camera model, by its number in a file.
_PARAMETERS = {
    int(number): len(pycolmap.Camera.create_from_model_name(1, name, 1.0, 1, 1).params)
    for name, number in pycolmap.CameraModelId.__members__.items()
    if name != "INVALID"
}

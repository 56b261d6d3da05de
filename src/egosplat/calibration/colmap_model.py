"""Read a COLMAP model folder: ``cameras``, ``images`` and ``points3D``, all as .bin or all as .txt."""

import re
import struct
import tempfile
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from egosplat.calibration.contents import Contents
from egosplat.calibration.files import MODEL_FILES, MODEL_SUFFIXES, model_files, next_image, text_names
from egosplat.calibration.lens import Lens
from egosplat.errors import UserError
from egosplat.geometry import invert, make_pose

# A word of a line; a picture's name has an extension.
_NOT_FINITE = re.compile(rb"(?<!\S)[-+]?(nan|inf|infinity)(?!\S)", re.IGNORECASE)

# A quaternion that was written with few digits.
_MAX_LENGTH_ERROR = 1e-3

# Number of parameters of each camera model, by its number in a file.
_PARAMETERS = {
    int(number): len(pycolmap.Camera.create_from_model_name(1, name, 1.0, 1, 1).params)
    for name, number in pycolmap.CameraModelId.__members__.items()
    if name != "INVALID"
}


def read_model(folder: Path) -> Contents:
    """Read the cameras, the poses and the points of a model; UserError if a file is missing or damaged."""
    files = model_files(folder)
    suffix = files[0].suffix if files else MODEL_SUFFIXES[0]
    if missing := [name for name in MODEL_FILES if folder / f"{name}{suffix}" not in files]:
        raise UserError(
            f"{folder}: has no {', '.join(f'{name}{suffix}' for name in missing)}. A COLMAP model has cameras, images and "
            "points3D, all .bin or all .txt."
        )
    model = _read(folder, files)
    images = sorted(
        (image for image in model.images.values() if image.has_pose), key=lambda image: image.name
    )
    if not images:
        raise UserError(f"{folder}: has no image with a pose.")
    used = [model.cameras[image.camera_id] for image in images]
    cameras = [
        Lens(camera.model_name, camera.width, camera.height, tuple(map(float, camera.params)))
        for camera in used
    ]
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


def _read(folder: Path, files: list[Path]) -> pycolmap.Reconstruction:
    for file in files:
        (_check_whole if file.suffix == ".bin" else _check_finite)(file)
    # COLMAP reads every file that it finds; here the three that are checked.
    with tempfile.TemporaryDirectory(prefix="egosplat-model-") as scratch:
        for file in files:
            (Path(scratch) / file.name).symlink_to(file.absolute())
        try:
            model = pycolmap.Reconstruction(scratch)
        except (ValueError, IndexError, RuntimeError, OSError) as error:
            reason = str(error).replace(f"{scratch}/", "").partition("\n")[0][-200:]
            raise UserError(f"{folder}: not a readable COLMAP model ({reason}). Export it again.") from error
    path = folder / "images.txt"
    # COLMAP reads a name to its first space.
    if path in files and (broken := next((name for name in text_names(path) if " " in name), None)):
        raise UserError(
            f"{path}: {broken}: the text format holds no names with spaces. Export the model as .bin."
        )
    return model


def _check_finite(path: Path) -> None:
    """Raise UserError unless a text file has finite numbers: COLMAP tells neither the file nor the line of another one."""
    content = path.read_bytes()
    for match in _NOT_FINITE.finditer(content):
        begin = content.rfind(b"\n", 0, match.start()) + 1
        # COLMAP writes means into comments, which are not finite if there is nothing to average.
        if content[begin : begin + 1] != b"#":
            line = content.count(b"\n", 0, begin) + 1
            raise UserError(
                f"{path}: line {line}: {match[0].decode()} is no finite number. Export the "
                "model again, or leave out what the line describes."
            )


def _check_whole(path: Path) -> None:
    """Raise UserError unless a binary file ends where its last record ends: COLMAP would wait or invent values."""
    content, position = path.read_bytes(), 8
    try:
        for _ in range(*struct.unpack_from("<Q", content)):
            position = _next_record(path.stem, content, position)
            if position > len(content):
                break
    except (struct.error, ValueError, KeyError):
        position = -1
    if position != len(content):
        raise UserError(f"{path}: damaged or incomplete ({len(content)} bytes). Copy it again.")


def _next_record(kind: str, content: bytes, position: int) -> int:
    """The end of a camera, an image or a point that begins at a position."""
    if kind == "cameras":
        return position + 24 + 8 * _PARAMETERS[struct.unpack_from("<ii", content, position)[1]]
    if kind == "points3D":
        return position + 51 + 8 * struct.unpack_from("<Q", content, position + 43)[0]
    return next_image(content, position)[1]

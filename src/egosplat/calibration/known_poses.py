"""Known poses of a plain recording: a COLMAP model folder, or a nerfstudio ``transforms.json`` (docs/recordings.md)."""

import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from egosplat.calibration.colmap_model import read_model
from egosplat.calibration.contents import Contents
from egosplat.calibration.files import KNOWN_POSES, known_poses_path, present_known_poses
from egosplat.calibration.transforms_json import read_transforms
from egosplat.errors import UserError
from egosplat.geometry import is_rigid

# A rotation that was written with few digits is made orthonormal up to this deviation.
_MAX_DEVIATION = 1e-3
# Number of names listed in a message.
_MAX_NAMES = 3
# Share of the cameras by which the size of the scene is told, and the farthest from the origin in units of it: float32 then
# still tells a pixel from the next.
_MOST, _MAX_REACH = 0.9, 1e4
# Not every end after a dot is an extension: ``frame.0001``.
_EXTENSIONS = (
    *(".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp", ".gif", ".heic", ".heif", ".avif", ".jxl"),
    *(".exr", ".ppm", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf"),
)


def find_known_poses(recording: Path, wanted: str) -> str | None:
    """The kind of a recording's known poses, a key of ``KNOWN_POSES``, by ``frames.known_poses``; None without any.

    Raises:
        UserError: the wanted file does not exist, or ``auto`` finds two.
    """
    present = present_known_poses(recording, wanted)
    if wanted in KNOWN_POSES and not present:
        path = known_poses_path(recording, wanted)
        raise UserError(f"{path}: not found, but frames.known_poses is {wanted}.")
    if len(present) > 1:
        folder = recording if recording.is_dir() else recording.parent
        names = " and ".join(os.path.relpath(known_poses_path(recording, kind), folder) for kind in present)
        raise UserError(f"{recording}: has {names}. Choose with frames.known_poses={' or '.join(present)}.")
    return present[0] if present else None


def read_known_poses(recording: Path, kind: str, width: int, height: int) -> Contents:
    """Read the known poses of a recording.

    Args:
        kind: from ``find_known_poses``.
        width, height: size of the recording's full pictures [px], for a file that does not name it.

    Raises:
        UserError: the file is damaged, a camera is not supported, or a pose is not rigid or far from all others.
    """
    path = known_poses_path(recording, kind)
    contents = read_model(path) if kind == "colmap" else read_transforms(path, width, height)
    for index, lens in enumerate(contents.lenses):
        first = contents.names[int((contents.lens_of == index).argmax())]
        lens.check(f"{contents.camera_file}: {first}" if len(contents.lenses) > 1 else contents.camera_file)
    wheres = [f"{contents.pose_file}: {name}" for name in contents.names]
    poses = np.stack([_rigid(*pair) for pair in zip(contents.camera_to_world, wheres, strict=True)])
    _check_positions(poses[:, :3, 3], wheres)
    return replace(contents, camera_to_world=poses)


def _check_positions(centers: NDArray[np.float64], wheres: Sequence[str]) -> None:
    """Raise UserError unless the origin and all cameras are near each other, as float32 needs."""
    # The largest coordinate stands for the length, whose square may overflow.
    away = np.abs(centers - np.median(centers, axis=0)).max(axis=1)
    spread = float(np.quantile(away, _MOST, method="lower"))
    farthest = int(np.abs(centers).max(axis=1).argmax())
    reach = float(np.abs(centers[farthest]).max())
    # Cameras at one place have no spread.
    if reach > _MAX_REACH * (spread or 1.0):
        raise UserError(
            f"{wheres[farthest]}: {reach:.3g} from the origin, but most cameras lie within {spread:.3g} of each other. "
            "Remove the pose, or subtract an offset from all positions and points."
        )


def _rigid(pose: NDArray[np.float64], where: str) -> NDArray[np.float64]:
    """Return a pose whose rotation is orthonormal; up to ``_MAX_DEVIATION`` it is corrected."""
    if not np.isfinite(pose).all():
        raise UserError(f"{where}: the pose has a value that is not finite.")
    if is_rigid(pose):
        return pose
    if not is_rigid(pose, _MAX_DEVIATION):
        raise UserError(f"{where}: the pose is not a rotation and a translation (is it scaled or mirrored?).")
    corrected = pose.copy()
    corrected[:3, :3] = Rotation.from_matrix(pose[:3, :3]).as_matrix()
    corrected[3] = [0.0, 0.0, 0.0, 1.0]
    return corrected


def match_pictures(
    names: Sequence[str], pictures: Sequence[str], path: Path
) -> tuple[NDArray[np.int64], list[str]]:
    """Assign the entries of a file to pictures: one name is the end of the other, whose extension may differ.

    Args:
        names: of the entries, such as ``images/0001.jpg``.
        pictures: of the pictures from the recording's folder, or the numbers of a video's frames, counted from 0.
        path: of the file, for errors.

    Returns:
        (P,) int64, the entry of each picture, -1 where there is none; and the names of the entries that match no picture.

    Raises:
        UserError: two entries match one picture, an entry matches two, or no entry matches any.
    """
    endings: dict[tuple[str, ...], list[int]] = {}
    for index, parts in enumerate(map(_parts, pictures)):
        for start in range(len(parts)):
            endings.setdefault(parts[start:], []).append(index)
    numbers: dict[int | None, int] = {}
    if all(re.fullmatch("[0-9]+", picture) for picture in pictures):
        numbers = {int(picture): index for index, picture in enumerate(pictures)}
    row, unmatched = np.full(len(pictures), -1, np.int64), []
    for entry, name in enumerate(names):
        picture = numbers.get(number_of(name)) if numbers else _picture_of(name, endings, pictures, path)
        if picture is None:
            unmatched.append(name)
        elif row[picture] >= 0:
            raise UserError(
                f"{path}: {names[row[picture]]} and {name} are both the picture {pictures[picture]}."
            )
        else:
            row[picture] = entry
    if not (row >= 0).any():
        raise UserError(
            f"{path}: none of its {len(names)} names, such as {', '.join(unmatched[:_MAX_NAMES])}, is the name of a "
            f"picture, such as {pictures[0]}."
        )
    return row, unmatched


def check_numbers(names: Sequence[str], count: int, path: Path) -> None:
    """Raise UserError if an entry numbers a frame that a video of ``count`` has not, as where numbers begin at 1."""
    for name in names:
        if (number_of(name) or 0) >= count:
            raise UserError(
                f"{path}: {name}: the video has the frames 0 to {count - 1}. Do the numbers begin at 1?"
            )


def number_of(name: str) -> int | None:
    """The number of a video's frame that an entry is named by; None if it is no number."""
    stem = _parts(name)[-1]
    return int(stem) if re.fullmatch("[0-9]+", stem) else None


def _picture_of(
    name: str, endings: dict[tuple[str, ...], list[int]], pictures: Sequence[str], path: Path
) -> int | None:
    """The picture that an entry means, by the longest ending of its name that is the whole name of one of the two."""
    parts = _parts(name)
    tails = [parts[start:] for start in range(len(parts))]
    whole = [index for tail in tails for index in endings.get(tail, ()) if _parts(pictures[index]) == tail]
    matches = whole[:1] or endings.get(parts, [])
    if len(matches) > 1:
        first, second = (pictures[index] for index in matches[:2])
        raise UserError(f"{path}: {name} is both {first} and {second}; name its folder.")
    return matches[0] if matches else None


def unmatched_line(unmatched: list[str], path: Path) -> str:
    """The log line about entries without a picture."""
    more = ", ..." if len(unmatched) > _MAX_NAMES else ""
    listed = ", ".join(unmatched[:_MAX_NAMES])
    plural = "s" if len(unmatched) > 1 else ""
    return f"{path}: ignores {len(unmatched)} name{plural} without a picture: {listed}{more}"


def _parts(name: str) -> tuple[str, ...]:
    """The folders and the name of a picture, without its extension."""
    base = PurePosixPath(name.replace("\\", "/"))
    known = base.suffix.lower() in _EXTENSIONS
    return (*base.parts[:-1], base.stem if known else base.name)

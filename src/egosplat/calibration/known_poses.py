"""Known poses of a plain recording: a COLMAP model folder, or a nerfstudio ``transforms.json`` (docs/recordings.md)."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from unicodedata import normalize

import numpy as np
from scipy.spatial.transform import Rotation

from egosplat.arrays import Ints
from egosplat.calibration import files
from egosplat.calibration.colmap_model import Contents, read_model
from egosplat.calibration.transforms_json import read_transforms
from egosplat.errors import UserError
from egosplat.geometry import is_rigid
from egosplat.progress import log

# A rotation that was written with few digits is made orthonormal up to this deviation.
_MAX_DEVIATION = 1e-3
# Share of the cameras by which the size of the scene is told, and the farthest from the origin in units of it: float32 then
# still tells a pixel from the next.
_MOST, _MAX_REACH = 0.9, 1e4


def find_known_poses(recording: Path, wanted: str) -> str | None:
    """The kind of a recording's known poses, a key of ``files.KNOWN_POSES``, by ``frames.known_poses``; None
    without any. UserError if the wanted file does not exist, or ``auto`` finds two."""
    present = files.present_known_poses(recording, wanted)
    if wanted in files.KNOWN_POSES and not present:
        path = files.known_poses_path(recording, wanted)
        raise UserError(f"{path}: not found, but frames.known_poses is {wanted}.")
    if len(present) > 1:
        both = " and ".join(str(files.known_poses_path(recording, kind)) for kind in present)
        raise UserError(f"{both}: choose with frames.known_poses={' or '.join(present)}.")
    if present == ["colmap"]:
        files.check_parts(recording)
    if wanted == files.AUTO and not present and recording.is_dir() and (told := files.other_poses(recording)):
        log(told)
    return present[0] if present else None


def read_known_poses(recording: Path, kind: str, width: int, height: int) -> Contents:
    """Read the known poses of a recording, of a kind from ``find_known_poses``. ``width`` and ``height`` are
    those of the full pictures [px], for a file that does not name them. UserError if the file is damaged, a
    camera is not supported, or a pose is not rigid or far from all others."""
    path = files.known_poses_path(recording, kind)
    contents = read_model(path) if kind == "colmap" else read_transforms(path, width, height)
    for lens in contents.lenses:
        lens.check(f"{path}: {contents.names[contents.cameras.index(lens)]}")
    poses = contents.camera_to_world.copy()
    if (odd := ~is_rigid(poses, _MAX_DEVIATION)).any():
        fault = "the pose is not a rotation and a translation of finite numbers (is it scaled or mirrored?)"
        raise UserError(f"{path}: {contents.names[odd.argmax()]}: {fault}.")
    if (rough := ~is_rigid(poses)).any():
        poses[rough, :3, :3] = Rotation.from_matrix(poses[rough, :3, :3]).as_matrix()
        poses[rough, 3] = [0.0, 0.0, 0.0, 1.0]
    # The largest coordinate stands for the length, whose square may overflow.
    centers = poses[:, :3, 3]
    away = np.abs(centers - np.median(centers, axis=0)).max(axis=1)
    spread, reach = float(np.quantile(away, _MOST, method="lower")), np.abs(centers).max(axis=1)
    # Cameras at one place have no spread.
    if reach.max() > _MAX_REACH * (spread or 1.0):
        raise UserError(
            f"{path}: {contents.names[reach.argmax()]}: {reach.max():.3g} from the origin, but most cameras lie within "
            f"{spread:.3g} of each other. Remove the pose, or subtract an offset from all positions and points."
        )
    return replace(contents, camera_to_world=poses)


def match_pictures(names: Sequence[str], pictures: Sequence[str], path: Path) -> tuple[Ints, list[str]]:
    """Assign the entries of a file to pictures: one name is the end of the other, whose extension may differ.
    ``pictures`` are names from the recording's folder, or the numbers of a video's frames, counted from 0.
    Returns (P,) int64, the entry of each picture, -1 where there is none, and the names of the entries that
    match no picture. UserError, of the file ``path``, if two entries match one picture, an entry matches two,
    or no entry matches any."""
    by_stem: dict[str, list[tuple[int, tuple[str, ...]]]] = {}
    for index, parts in enumerate(map(_parts, pictures)):
        by_stem.setdefault(parts[-1], []).append((index, parts))
    is_video = all(re.fullmatch("[0-9]+", picture) for picture in pictures)
    numbers = {int(picture): index for index, picture in enumerate(pictures)} if is_video else {}
    row, unmatched = np.full(len(pictures), -1, np.int64), []
    for entry, name in enumerate(names):
        matches = _matches(_parts(name), by_stem)
        if is_video:
            matches = [numbers[number] for number in [_number_of(name)] if number in numbers]
        if len(matches) > 1:
            first, second = (pictures[index] for index in matches[:2])
            raise UserError(f"{path}: {name} is both {first} and {second}; name its folder.")
        for picture in matches:
            if row[picture] >= 0:
                both = f"{names[row[picture]]} and {name}"
                raise UserError(f"{path}: {both} are both the picture {pictures[picture]}.")
            row[picture] = entry
        if not matches:
            unmatched.append(name)
    if not (row >= 0).any():
        few = f"none of its {len(names)} names, such as {unmatched[0]}"
        raise UserError(f"{path}: {few}, is the name of a picture, such as {pictures[0]}.")
    return row, unmatched


def _matches(own: tuple[str, ...], by_stem: dict[str, list[tuple[int, tuple[str, ...]]]]) -> list[int]:
    """The picture with the longest name that ends an entry's own; without any, all whose name the entry ends."""
    named = [
        (index, parts)
        for index, parts in by_stem.get(own[-1], ())
        if all(mine == other for mine, other in zip(own[::-1], parts[::-1], strict=False))
    ]
    whole = sorted((pair for pair in named if len(pair[1]) <= len(own)), key=lambda pair: -len(pair[1]))
    return [index for index, _ in whole[:1] or named]


def check_numbers(names: Sequence[str], count: int, path: Path) -> None:
    """Raise UserError if an entry numbers a frame that a video of ``count`` has not, as where numbers begin at 1."""
    if beyond := next((name for name in names if (_number_of(name) or 0) >= count), None):
        has = f"the video has the frames 0 to {count - 1}"
        raise UserError(f"{path}: {beyond}: {has}. Do the numbers begin at 1?")


def _number_of(name: str) -> int | None:
    """The number of a video's frame that an entry is named by; None if it is no number."""
    stem = _parts(name)[-1]
    return int(stem) if re.fullmatch("[0-9]+", stem) else None


def _parts(name: str) -> tuple[str, ...]:
    """The folders and the name of a picture, without its extension."""
    base = PurePosixPath(normalize("NFC", name).replace("\\", "/"))
    # Not every end after a dot is an extension: ``frame.0001``.
    known = base.suffix.lower() in (*files.PICTURES, *files.OTHER_PICTURES)
    return (*base.parts[:-1], base.stem if known else base.name)

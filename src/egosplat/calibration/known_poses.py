"""Known poses of a plain recording: a COLMAP model folder, or a nerfstudio ``transforms.json`` (docs/recordings.md)."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from egosplat.calibration import colmap_model, transforms_json
from egosplat.calibration.companions import KNOWN_POSES, companion_path, present_known_poses
from egosplat.calibration.contents import Contents
from egosplat.errors import UserError
from egosplat.geometry import is_rigid

# A rotation that was written with few digits is made orthonormal up to this deviation.
_MAX_DEVIATION = 1e-3
# Number of names listed in a message.
_MAX_NAMES = 3


@dataclass(frozen=True)
class Match:
    """Which entry of a file belongs to which picture.

    Attributes:
        row: (P,) int64: the entry of each picture; -1 where there is none.
        unmatched: names of the entries that match no picture.
    """

    row: NDArray[np.int64]
    unmatched: list[str]


def find_known_poses(recording: Path, wanted: str) -> str | None:
    """The kind of the recording's known poses, a key of ``KNOWN_POSES``; None if there are none.

    Args:
        wanted: ``frames.known_poses``.

    Raises:
        UserError: the wanted file does not exist, or ``auto`` finds two.
    """
    present = present_known_poses(recording, wanted)
    if wanted in KNOWN_POSES and not present:
        path = companion_path(recording, KNOWN_POSES[wanted])
        raise UserError(f"{path}: not found, but frames.known_poses is {wanted}.")
    if len(present) > 1:
        names = " and ".join(companion_path(recording, KNOWN_POSES[kind]).name for kind in present)
        raise UserError(f"{recording}: has {names}. Choose with frames.known_poses={' or '.join(present)}.")
    return present[0] if present else None


def read_known_poses(recording: Path, kind: str, width: int, height: int) -> Contents:
    """Read the known poses of a recording.

    Args:
        kind: from ``find_known_poses``.
        width, height: size of the recording's full pictures [px].

    Raises:
        UserError: the file is damaged, its camera is not supported or has another size, or a pose is not rigid.
    """
    path = companion_path(recording, KNOWN_POSES[kind])
    read = {"colmap": colmap_model.read_model, "transforms": transforms_json.read_transforms}[kind]
    contents = read(path, width, height)
    lens = contents.lens.check(contents.camera_file)
    if (lens.width, lens.height) != (width, height):
        raise UserError(
            f"{contents.camera_file}: for {lens.width}x{lens.height} px, but the frames are {width}x{height}."
        )
    poses = np.stack(
        [
            _rigid(pose, f"{contents.pose_file}: {name}")
            for name, pose in zip(contents.names, contents.camera_to_world, strict=True)
        ]
    )
    return contents.with_poses(poses)


def match_pictures(names: Sequence[str], pictures: Sequence[str], path: Path) -> Match:
    """Assign the entries of a file to pictures by name; folders do not count, and extensions may differ.

    Args:
        names: of the entries, such as ``images/0001.jpg``.
        pictures: file names of the pictures, or the numbers of a video's frames, counted from 0.
        path: of the file, for errors.

    Raises:
        UserError: two entries match one picture, or no entry matches any.
    """
    place = {picture: index for index, picture in enumerate(pictures)}
    place |= {PurePosixPath(picture).stem: index for index, picture in enumerate(pictures)}
    row, unmatched = np.full(len(pictures), -1, np.int64), []
    for entry, name in enumerate(names):
        found = next((place[key] for key in _keys(name) if key in place), None)
        if found is None:
            unmatched.append(name)
        elif row[found] >= 0:
            raise UserError(f"{path}: {names[row[found]]} and {name} are both the picture {pictures[found]}.")
        else:
            row[found] = entry
    if not (row >= 0).any():
        raise UserError(
            f"{path}: none of its {len(names)} names, such as {', '.join(unmatched[:_MAX_NAMES])}, is the name of a "
            f"picture, such as {pictures[0]}."
        )
    return Match(row, unmatched)


def unmatched_line(match: Match, path: Path) -> str | None:
    """The log line about entries without a picture; None if there are none."""
    if not match.unmatched:
        return None
    more = ", ..." if len(match.unmatched) > _MAX_NAMES else ""
    listed = ", ".join(match.unmatched[:_MAX_NAMES])
    plural = "s" if len(match.unmatched) > 1 else ""
    return f"{path}: ignores {len(match.unmatched)} name{plural} without a picture: {listed}{more}"


def _keys(name: str) -> list[str]:
    """The spellings under which a picture may be known, the most exact first."""
    base = PurePosixPath(name.replace("\\", "/"))
    number = [str(int(base.stem))] if re.fullmatch(r"[0-9]+", base.stem) else []
    return [base.name, base.stem, *number]


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

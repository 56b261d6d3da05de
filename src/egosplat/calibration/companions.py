"""The files that accompany a plain recording, and those of its known poses. The workflow imports this module, so it stays light."""

import math
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from egosplat.files import read_json

# Formats of recordings that have these files. Labels choose the evaluation frames of the last two.
OF_PICTURES = ("plain", "lerf", "3d_ovs")

# The files with known poses, by the value of ``frames.known_poses``.
KNOWN_POSES = {"colmap": "colmap", "transforms": "transforms.json"}

# Other values of ``frames.known_poses``: those that are there, and none.
AUTO, NONE = "auto", "none"

# The model in the folder of a COLMAP project, whose pictures lie in ``images``.
PROJECT_MODELS, PROJECT_PICTURES = ("sparse/0", "sparse"), "images"

# The formats of pictures that are read.
PICTURES = (".png", ".jpg", ".jpeg")

# Files of a COLMAP model that are read. rigs and frames of newer versions repeat what these three say of a single camera.
MODEL_FILES = ("cameras", "images", "points3D")

# COLMAP itself prefers .bin where both exist.
MODEL_SUFFIXES = (".bin", ".txt")

# Registering fewer frames is no loss to accept: most of the recording would be missing.
_LEAST_ADVISED = 0.5


def companion_path(source: Path, name: str) -> Path:
    """Path of a companion file of a plain recording: in the image folder, or next to the video as ``clip.mp4.<name>``."""
    return source / name if source.is_dir() else source.with_name(f"{source.name}.{name}")


def present_known_poses(recording: Path, wanted: str) -> list[str]:
    """The kinds of known poses of a recording that ``frames.known_poses`` allows, keys of ``KNOWN_POSES``."""
    kinds = [] if wanted == NONE else [*KNOWN_POSES] if wanted == AUTO else [wanted]
    # A broken link counts as present: reading it reports the error.
    present = [kind for kind in kinds if os.path.lexists(known_poses_path(recording, kind))]
    if len(present) > 1 and not model_files(known_poses_path(recording, "colmap")):
        # nerfstudio keeps COLMAP's database in a folder of this name.
        present.remove("colmap")
    return present


def known_poses_path(recording: Path, kind: str) -> Path:
    """The file or folder with the known poses of a kind, which need not exist."""
    path = companion_path(recording, KNOWN_POSES[kind])
    places = (path, *(recording / place for place in PROJECT_MODELS)) if kind == "colmap" else ()
    return next((place for place in places if model_files(place)), path)


def poses_source(method: str, has_device: bool, has_known: bool) -> str:
    """Where poses come from, by ``poses.method`` and what there is: ``device``, ``known`` or ``colmap``."""
    if method != AUTO:
        return method
    return "known" if has_known else "device" if has_device else "colmap"


def known_pose_files(recording: Path, wanted: str) -> list[Path]:
    """The files of a recording's known poses; those of every kind if it has several."""
    kinds = present_known_poses(recording, wanted)
    files = {"colmap": model_files, "transforms": transforms_files}
    return [file for kind in kinds for file in files[kind](known_poses_path(recording, kind))]


def model_files(folder: Path) -> list[Path]:
    """The three files of a COLMAP model, all .bin or all .txt; fewer if one is missing in both formats."""
    found = [[folder / f"{name}{suffix}" for name in MODEL_FILES] for suffix in MODEL_SUFFIXES]
    present = [[file for file in files if file.is_file()] for files in found]
    return max(present, key=len)


def transforms_files(path: Path) -> list[Path]:
    """A ``transforms.json``, and the file with its points if it names one."""
    points = points_path(path, _document(path))
    return [path] if points is None else [path, points]


def points_path(path: Path, document: Any) -> Path | None:
    """The PLY file that the document of a ``transforms.json`` at ``path`` names; None if it names none."""
    name = document.get("ply_file_path") if isinstance(document, dict) else None
    return path.parent / name if isinstance(name, str) else None


def mask_files(recording: Path, wanted: str) -> list[Path]:
    """The masks of single pictures that a recording's ``transforms.json`` names."""
    if "transforms" not in present_known_poses(recording, wanted):
        return []
    path = known_poses_path(recording, "transforms")
    return [path.parent / name for name in dict.fromkeys(_texts(_document(path), "mask_path"))]


def picture_folders(recording: Path, wanted: str) -> list[Path]:
    """The folders with the pictures of a folder's recording: those that its known poses name, or the folder itself.

    A folder without pictures may have them in ``images``.
    """
    names = [name for kind in present_known_poses(recording, wanted) for name in _names(recording, kind)]
    found = (_named_folders(recording, root, names) for root in (recording, recording / PROJECT_PICTURES))
    places = ([place] for place in (recording, recording / PROJECT_PICTURES) if place.is_dir())
    return next((folders for folders in (*found, *places) if any(map(_has_pictures, folders))), [recording])


def _named_folders(recording: Path, root: Path, names: list[str]) -> list[Path]:
    """The folders of a recording to which names lead from ``root``."""
    named = (os.path.normpath((root / name.replace("\\", "/")).parent) for name in names)
    folders = map(Path, dict.fromkeys(named))
    return [
        each for each in folders if each.is_relative_to(os.path.normpath(recording)) and os.path.isdir(each)
    ]


def _has_pictures(folder: Path) -> bool:
    return any(path.suffix.lower() in PICTURES for path in folder.iterdir())


def _names(recording: Path, kind: str) -> list[str]:
    """The names of pictures in a file with known poses; none of a damaged one, whose reader reports it."""
    path = known_poses_path(recording, kind)
    if kind == "transforms":
        return _texts(_document(path), "file_path")
    (images,) = [file for file in model_files(path) if file.stem == "images"] or [None]
    try:
        return [] if images is None else [*(text_names if images.suffix == ".txt" else _binary_names)(images)]
    except (OSError, ValueError, IndexError, struct.error):
        return []


def _binary_names(path: Path) -> Iterator[str]:
    """The names in COLMAP's ``images.bin``: after 64 bytes of numbers, before 24 for each point."""
    content = path.read_bytes()
    (count,) = struct.unpack_from("<Q", content)
    position = 8
    for _ in range(count):
        end = content.index(b"\0", position + 64)
        yield content[position + 64 : end].decode()
        position = end + 9 + 24 * struct.unpack_from("<Q", content, end + 1)[0]


def text_names(path: Path) -> Iterator[str]:
    """The names in COLMAP's ``images.txt``: the tenth word of every second line, spaces included."""
    lines = iter(path.read_text(encoding="utf-8").splitlines())
    for line in lines:
        if line.strip() and not line.startswith("#"):
            yield line.split(maxsplit=9)[9].strip()
            next(lines, None)


def _document(path: Path) -> Any:
    try:
        return read_json(path)
    except (OSError, ValueError):
        return None


def _texts(document: Any, key: str) -> list[str]:
    """The texts of a key in the frames of a ``transforms.json``."""
    frames = document.get("frames") if isinstance(document, dict) else None
    given = [
        frame.get(key) for frame in (frames if isinstance(frames, list) else []) if isinstance(frame, dict)
    ]
    return [text for text in given if isinstance(text, str) and text]


def accept_advice(registered: int, frames: int) -> str:
    """How to accept the loss of frames without a pose; empty if most of them have none."""
    # Rounded down, so that the suggested value accepts this model.
    share = math.floor(100 * registered / frames) / 100
    return f"accept the loss: poses.min_registered={share:g}" if share >= _LEAST_ADVISED else ""

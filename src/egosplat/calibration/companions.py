"""The files that accompany a plain recording, and those of its known poses. The workflow imports this module, so it stays light."""

import os
from pathlib import Path
from typing import Any

from egosplat.files import read_json

# The files with known poses, by the value of ``frames.known_poses``.
KNOWN_POSES = {"colmap": "colmap", "transforms": "transforms.json"}

# Other values of ``frames.known_poses``: those that are there, and none.
AUTO, NONE = "auto", "none"

# Files of a COLMAP model that are read. rigs and frames of newer versions repeat what these three say of a single camera.
MODEL_FILES = ("cameras", "images", "points3D")

# COLMAP itself prefers .bin where both exist.
MODEL_SUFFIXES = (".bin", ".txt")


def companion_path(source: Path, name: str) -> Path:
    """Path of a file that accompanies a plain recording.

    It lies in the image folder, or next to the video as ``clip.mp4.<name>``.
    """
    return source / name if source.is_dir() else source.with_name(f"{source.name}.{name}")


def present_known_poses(recording: Path, wanted: str) -> list[str]:
    """The kinds of known poses of a recording that ``frames.known_poses`` allows, keys of ``KNOWN_POSES``."""
    kinds = [] if wanted == NONE else [*KNOWN_POSES] if wanted == AUTO else [wanted]
    # A broken link counts as present: reading it reports the error.
    return [kind for kind in kinds if os.path.lexists(companion_path(recording, KNOWN_POSES[kind]))]


def poses_source(method: str, has_device: bool, has_known: bool) -> str:
    """Where the poses of a recording come from: ``device``, ``known`` or ``colmap``.

    Args:
        method: ``poses.method``.
        has_device: whether its device recorded a trajectory.
        has_known: whether its poses are known.
    """
    if method != AUTO:
        return method
    return "known" if has_known else "device" if has_device else "colmap"


def known_pose_files(recording: Path, wanted: str) -> list[Path]:
    """The files of a recording's known poses; those of every kind if it has several."""
    kinds = present_known_poses(recording, wanted)
    files = {"colmap": model_files, "transforms": transforms_files}
    return [file for kind in kinds for file in files[kind](companion_path(recording, KNOWN_POSES[kind]))]


def model_files(folder: Path) -> list[Path]:
    """The three files of a COLMAP model, all .bin or all .txt; fewer if one is missing in both formats."""
    found = [[folder / f"{name}{suffix}" for name in MODEL_FILES] for suffix in MODEL_SUFFIXES]
    present = [[file for file in files if file.is_file()] for files in found]
    return max(present, key=len)


def transforms_files(path: Path) -> list[Path]:
    """A ``transforms.json``, and the file with its points if it names one."""
    try:
        points = points_path(path, read_json(path))
    except (OSError, ValueError):
        points = None
    return [path] if points is None else [path, points]


def points_path(path: Path, document: Any) -> Path | None:
    """The PLY file that the document of a ``transforms.json`` at ``path`` names; None if it names none."""
    name = document.get("ply_file_path") if isinstance(document, dict) else None
    return path.parent / name if isinstance(name, str) else None

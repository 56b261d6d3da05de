"""Copies of recordings with some of their files."""

import shutil
from collections.abc import Iterable
from pathlib import Path

from egosplat.calibration.files import opened_files


def copy_files(files: Iterable[Path], root: Path, target: Path) -> Path:
    """Copy files below ``root`` to the same places below ``target``, and return it."""
    for file in files:
        place = target / file.relative_to(root)
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, place)
    return target


def opened(stage: str, format: str, recording: Path, known: str = "auto", **poses: str) -> list[Path]:
    """The files of a recording that a stage opens, by ``frames.known_poses`` and keys of ``poses``."""
    keys = {"method": "auto", "trajectory": "closed_loop"} | poses
    return opened_files(stage, format, recording, {"frames": {"known_poses": known}, "poses": keys})

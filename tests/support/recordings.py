"""Copies of recordings with some of their files."""

import shutil
from collections.abc import Iterable
from pathlib import Path


def copy_files(files: Iterable[Path], root: Path, target: Path) -> Path:
    """Copy files below ``root`` to the same places below ``target``, and return it."""
    for file in files:
        place = target / file.relative_to(root)
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, place)
    return target

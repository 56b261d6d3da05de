"""The files that lie beside a plain recording: inside an image folder, or next to a video (``clip.mp4.camera.json``)."""

import os
from pathlib import Path

ANNOTATIONS = "annotations"
"""Folder of the annotations."""


def companion(path: Path, name: str) -> Path:
    """Where a file that belongs to a source lies: in the image folder, or beside the video."""
    return path / name if path.is_dir() else path.with_name(f"{path.name}.{name}")


def is_annotated(format: str, path: Path) -> bool:
    """Whether a recording has something to evaluate with, as far as its format tells without reading it.

    ADT and HOI4D come with annotations. A plain recording has some where the folder exists; a link that leads nowhere
    counts, and is refused when it is read.
    """
    return format != "plain" or os.path.lexists(companion(path, ANNOTATIONS))

"""Read the pictures of a scene of LERF-OVS: LangSplat's labels choose the evaluation frames (docs/recordings.md).

A scene is the folder of a COLMAP project, ``figurines/images/`` and ``figurines/sparse/0/``; its labels lie beside it, in
``label/figurines/frame_00041.json`` for picture ``frame_00041.jpg``.
"""

from pathlib import Path

from egosplat.errors import UserError
from egosplat.frames.files import label_files, lerf_labels
from egosplat.frames.keys import ReaderKeys
from egosplat.frames.pictures import PlainRecording


def open_recording(path: Path, keys: ReaderKeys) -> PlainRecording:
    """Open the pictures of a scene."""
    return PlainRecording.labeled(path, keys, find_labels(path))


def find_labels(path: Path) -> dict[str, Path]:
    """The label of each labeled picture, by the picture's name without extension.

    Raises:
        UserError: there is none, or no such scene.
    """
    if not path.is_dir():
        raise UserError(f"{path}: no such folder. Give the folder of a scene, such as figurines.")
    labels = {label.stem: label for label in label_files("lerf", path)}
    if not labels:
        raise UserError(
            f"{lerf_labels(path)}: has no labels (frame_00041.json, ...). Get lerf_ovs/label/{path.absolute().name} of LangSplat's "
            "download, or read the scene as plain, without scores."
        )
    return labels

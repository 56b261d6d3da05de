"""Read the pictures of a scene of 3D-OVS: its class masks choose the evaluation frames (docs/recordings.md).

A scene has ``images/``, perhaps a COLMAP model in ``sparse/0/``, and ``segmentations/`` with ``classes.txt`` and a folder of
masks, ``04/CLASS.png``, for each labeled picture.
"""

from pathlib import Path

from egosplat.errors import UserError
from egosplat.frames.files import class_mask_folders, ovs_labels
from egosplat.frames.keys import ReaderKeys
from egosplat.frames.pictures import PlainRecording


def open_recording(path: Path, keys: ReaderKeys) -> PlainRecording:
    """Open the pictures of a scene."""
    return PlainRecording.labeled(path, keys, find_labels(path))


def find_labels(path: Path) -> dict[str, Path]:
    """The folder with the masks of each labeled picture, by the folder's name.

    Raises:
        UserError: there is none, or no such scene.
    """
    if not path.is_dir():
        raise UserError(f"{path}: no such folder. Give the folder of a scene, such as bed.")
    labels = {folder.name: folder for folder in class_mask_folders(path)}
    if not labels:
        raise UserError(
            f"{ovs_labels(path)}: has no folder of masks (04/CLASS.png). Get segmentations/ of 3D-OVS's download, or read the "
            "scene as plain, without scores."
        )
    return labels

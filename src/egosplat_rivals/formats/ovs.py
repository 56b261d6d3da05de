"""Read a scene of 3D-OVS, whose class masks choose the evaluation frames (docs/recordings.md).

``segmentations/classes.txt`` names a class a line, and ``segmentations/04/CLASS.png`` is white where picture ``04`` shows it.
"""

from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from egosplat.calibration.files import OVS_CLASSES, labels_folder, list_masks
from egosplat.errors import UserError
from egosplat.files import read_user_text
from egosplat.frames.images import read_rgb
from egosplat.frames.recording import AnnotationKeys, Annotations
from egosplat_rivals.formats.labeled_annotations import LabeledObject, annotate, find_labels, open_labeled

_WHITE = 128


open_recording = partial(open_labeled, "3d_ovs")


def open_annotations(path: Path, keys: AnnotationKeys) -> Annotations:
    """Read the class masks of a scene; UserError if a class has no name or mask, or a mask another size than its picture."""
    labels = find_labels("3d_ovs", path)
    classes = read_classes(labels_folder("3d_ovs", path) / OVS_CLASSES)

    def objects_of(folder: Path, size: tuple[int, int]) -> list[LabeledObject]:
        _check_names(folder, classes)
        masks = [_read_mask(folder / f"{name}.png", size) for name in classes]
        return [(index, mask) for index, mask in enumerate(masks) if mask.any()]

    return annotate(path, keys, labels, classes, objects_of)


def read_classes(path: Path) -> list[str]:
    """The names of the classes, sorted; UserError if the file cannot be read, names no class, or one twice."""
    try:
        lines = read_user_text(path).splitlines()
    except OSError as error:
        raise UserError(f"{path}: not readable ({error}). Get it from 3D-OVS's download.") from error
    classes = sorted(name for line in lines if (name := line.strip()))
    if not classes:
        raise UserError(f"{path}: names no class. Put one on each line.")
    if repeated := [name for name, other in pairwise(classes) if name == other]:
        raise UserError(f"{path}: names the class {repeated[0]!r} twice. Remove a line.")
    return classes


def _check_names(folder: Path, classes: list[str]) -> None:
    """Raise ``UserError`` if the masks of a picture are not those of the classes."""
    found = {mask.stem for mask in list_masks(folder)}
    if absent := [name for name in classes if name not in found]:
        raise UserError(
            f"{folder}: has no mask {absent[0]}.png, a class of {OVS_CLASSES}. Add it (black if the picture does not show it), "
            f"or remove the class."
        )
    if unknown := sorted(found - {*classes}):
        raise UserError(
            f"{folder / unknown[0]}.png: not a class of {OVS_CLASSES}. Add its name there, or remove the mask."
        )


def _read_mask(path: Path, size: tuple[int, int]) -> np.ndarray:
    """(H, W) bool: where the picture of ``size``, width and height, shows a class."""
    mask = np.asarray((read_rgb(path, turned=False) >= _WHITE).all(axis=2))
    if mask.shape[::-1] != size:
        raise UserError(
            f"{path}: {mask.shape[1]}x{mask.shape[0]} px, but its picture has {size[0]}x{size[1]}. Give the pictures that were labeled."
        )
    return mask

"""Labels of a benchmark's pictures: which pictures they belong to, and masks that overlap. Labels are for evaluation only."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.files import labels_folder, labels_of
from egosplat.calibration.lens import Rectifier
from egosplat.errors import UserError
from egosplat.frames.keys import AnnotationKeys
from egosplat.images import resize_labels

# Largest number of pictures' names in a message.
_MAX_NAMES = 3
# By format: an example of a scene, what its labels are, and what of a download has them.
_EXAMPLES = {
    "lerf": ("figurines", "labels (frame_00041.json, ...)", "lerf_ovs/label/{} of LangSplat's download"),
    "3d_ovs": ("bed", "folder of masks (04/CLASS.png)", "segmentations/ of 3D-OVS's download"),
}


def find_labels(format: str, path: Path) -> dict[str, Path]:
    """See ``labels_of``; UserError if there is no label, or no such scene."""
    scene, what, where = _EXAMPLES[format]
    if not path.is_dir():
        raise UserError(f"{path}: no such folder. Give the folder of a scene, such as {scene}.")
    if labels := labels_of(format, path):
        return labels
    raise UserError(
        f"{labels_folder(format, path)}: has no {what}. Get {where.format(path.absolute().name)}, or read the scene as "
        "plain, without scores."
    )


def match_labels(labels: Mapping[str, Path], pictures: Sequence[str]) -> dict[int, Path]:
    """The labels by the index of the picture, in its order.

    Args:
        labels: by the name of the picture, without folder and extension; or by its place in the natural order, from 0, if no
            picture is named by a number.
        pictures: names of the pictures.

    Raises:
        UserError: a label belongs to no picture, or to two.
    """
    stems = [PurePosixPath(name).stem for name in pictures]
    numbered = any(stem.isdecimal() for stem in stems)
    found: dict[int, Path] = {}
    for name, label in labels.items():
        places = [place for place, stem in enumerate(stems) if stem == name]
        if not places and not numbered and name.isdecimal() and int(name) < len(stems):
            places = [int(name)]
        if len(places) != 1:
            listed = ", ".join(pictures[place] for place in places) or "none"
            shown = ", ".join(pictures[:_MAX_NAMES])
            raise UserError(
                f"{label}: labels one picture, and {listed} of {shown}, ... is named {name}. Add the picture, or remove the label."
            )
        found[places[0]] = label
    return dict(sorted(found.items()))


def fit_labels(labels: NDArray[np.int32], time: int, keys: AnnotationKeys) -> NDArray[np.int32]:
    """Rectify and resize (h, w) labels of a picture to its frame at ``time`` [ns], (H, W)."""
    if lens := keys.originals.lenses.get(time):
        labels = Rectifier(lens, keys.originals.pinhole).labels(labels)
    return resize_labels(labels, keys.camera.width, keys.camera.height)


def paint_layers(
    objects: Iterable[tuple[int, NDArray[np.bool_]]], size: tuple[int, int]
) -> NDArray[np.int32]:
    """Paint masks that may overlap, (H, W) bool each, into (L, H, W) int32 maps of their indices; -1 for none.

    The first layer has all objects, smaller ones over larger ones; further layers have those that it shows in part, whole.
    """
    largest_first = sorted(objects, key=lambda one: -int(one[1].sum()))
    layers = [_paint(largest_first, size)]
    for index, mask in largest_first:
        if (layers[0][mask] == index).all():
            continue
        free = next((layer for layer in layers[1:] if (layer[mask] < 0).all()), None)
        if free is None:
            layers.append(_paint([(index, mask)], size))
        else:
            free[mask] = index
    return np.stack(layers)


def _paint(objects: Iterable[tuple[int, NDArray[np.bool_]]], size: tuple[int, int]) -> NDArray[np.int32]:
    painted = np.full(size, -1, np.int32)
    for index, mask in objects:
        painted[mask] = index
    return painted

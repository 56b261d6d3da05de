"""Labels of a benchmark's pictures: which pictures they belong to, and masks that overlap. For evaluation only."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.files import labels_folder, labels_of
from egosplat.errors import UserError
from egosplat.frames import pictures
from egosplat.frames.options import FramesOptions
from egosplat.frames.recording import AnnotationKeys, Annotations, Instance, Recording
from egosplat.frames.video import open_source

# Largest number of pictures' names in a message.
_MAX_NAMES = 3
# By format: an example of a scene, what its labels are, and what of a download has them.
_EXAMPLES = {
    "lerf": ("figurines", "labels (frame_00041.json, ...)", "lerf_ovs/label/{} of LangSplat's download"),
    "3d_ovs": ("bed", "folder of masks (04/CLASS.png)", "segmentations/ of 3D-OVS's download"),
}

# Index among the instances and (H, W) bool mask.
LabeledObject = tuple[int, NDArray[np.bool_]]


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


def open_labeled(format: str, path: Path, options: FramesOptions) -> Recording:
    """Open the pictures of a scene, of which the labeled ones are taken whatever the stride."""
    labels = find_labels(format, path)
    return pictures.open_recording(path, options, lambda names: [*match_labels(labels, names)])


def match_labels(labels: Mapping[str, Path], names: Sequence[str]) -> dict[int, Path]:
    """The labels of a benchmark by the index of the picture, in its order; UserError for one of no picture, or of two.

    ``labels`` are by the name of the picture, without folder and extension; or by its place in the natural order, from 0, if
    no picture is named by a number.
    """
    stems = [PurePosixPath(name).stem for name in names]
    numbered = any(stem.isdecimal() for stem in stems)
    matched: dict[int, Path] = {}
    for name, label in labels.items():
        indices = [index for index, stem in enumerate(stems) if stem == name]
        if not indices and not numbered and name.isdecimal() and int(name) < len(stems):
            indices = [int(name)]
        if len(indices) != 1:
            listed = ", ".join(names[index] for index in indices) or "none"
            shown = ", ".join(names[:_MAX_NAMES])
            raise UserError(
                f"{label}: labels one picture, and {listed} of {shown}, ... is named {name}. Add the picture, or remove the label."
            )
        matched[indices[0]] = label
    return dict(sorted(matched.items()))


def annotate(
    path: Path,
    keys: AnnotationKeys,
    labels: Mapping[str, Path],
    instances: Sequence[str],
    read_objects: Callable[[Path, tuple[int, int]], Sequence[LabeledObject]],
) -> Annotations:
    """Read the labels of ``match_labels`` of the pictures in the folder of a recording, as they lie in its frames.

    ``instances`` are the category of each instance; several of one category are told apart by numbers. ``read_objects`` reads
    the objects of a label, for a picture of a width and height.
    """
    source = open_source(path, keys.known_poses, turned=keys.turned)
    layers = {}
    for place, label in match_labels(labels, source.names).items():
        time, (width, height) = int(source.timestamp_ns[place]), source.sizes[place]
        painted = paint_layers(read_objects(label, (width, height)), (height, width))
        layers[time] = np.stack([keys.fit(layer, time) for layer in painted])
    return Annotations(_instances(instances), layers.get, max(map(len, layers.values())) - 1)


def _instances(categories: Sequence[str]) -> list[Instance]:
    instances = []
    for number, category in enumerate(categories, start=1):
        several = categories.count(category) > 1
        name = f"{category} {categories[:number].count(category)}" if several else category
        instances.append(Instance(number, name, category, "static", "object"))
    return instances


def paint_layers(objects: Iterable[LabeledObject], size: tuple[int, int]) -> NDArray[np.int32]:
    """Paint masks that may overlap, (H, W) bool each, into (L, H, W) int32 maps of their indices; -1 for none.

    The first layer has all objects, smaller ones over larger ones; further layers have those that it shows in part, whole.
    """
    largest_first = sorted(objects, key=lambda one: -int(one[1].sum()))
    layers = [np.full(size, -1, np.int32)]
    for index, mask in largest_first:
        layers[0][mask] = index
    for index, mask in largest_first:
        if (layers[0][mask] == index).all():
            continue
        free = next((layer for layer in layers[1:] if (layer[mask] < 0).all()), None)
        if free is None:
            layers.append(free := np.full(size, -1, np.int32))
        free[mask] = index
    return np.stack(layers)

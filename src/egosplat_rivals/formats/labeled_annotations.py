"""Make annotations of a benchmark's labels, whose objects may overlap. For evaluation only."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.frames.images import ImageFolder
from egosplat.frames.keys import AnnotationKeys
from egosplat.frames.labels import fit_labels, match_labels, paint_layers
from egosplat.frames.recording import Instance, LayeredAnnotations
from egosplat.frames.video import open_source

# Index among the instances and (H, W) bool mask.
LabeledObject = tuple[int, NDArray[np.bool_]]


def annotate(
    path: Path,
    keys: AnnotationKeys,
    labels: Mapping[str, Path],
    instances: Sequence[str],
    read_objects: Callable[[Path, tuple[int, int]], Sequence[LabeledObject]],
) -> LayeredAnnotations:
    """Read the labels of the pictures in the folder of a recording, as they lie in its frames.

    Args:
        labels: as of ``labels.match_labels``.
        instances: category of each instance. Several of one category are told apart by numbers.
        read_objects: reads the objects of a label, for a picture of a width and height.
    """
    source = open_source(path, keys.originals.known_poses)
    if not isinstance(source, ImageFolder):
        raise UserError(f"{path}: not a folder of pictures, to which its labels belong.")
    if keys.originals.turned:
        source.turn()
    layers = {}
    for place, label in match_labels(labels, source.names).items():
        time, (width, height) = int(source.timestamp_ns[place]), source.sizes[place]
        painted = paint_layers(read_objects(label, (width, height)), (height, width))
        layers[time] = np.stack([fit_labels(layer, time, keys) for layer in painted])
    return LayeredAnnotations(_instances(instances), layers)


def _instances(categories: Sequence[str]) -> list[Instance]:
    found: list[Instance] = []
    for number, category in enumerate(categories, start=1):
        same = sum(one.category == category for one in found)
        name = f"{category} {same + 1}" if categories.count(category) > 1 else category
        found.append(Instance(number, name, category, "static", "object"))
    return found

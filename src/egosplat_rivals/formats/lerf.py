"""Read a scene of LERF-OVS: the folder of a COLMAP project, and LangSplat's labels, which choose the evaluation frames.

A label ``label/figurines/frame_00041.json`` is a file of the annotation tool ISAT: ``info`` has width and height of the picture,
``objects`` a category and a polygon each, ``segmentation``, in pixels. Objects of one category in a picture are instances of
their own. The boxes of the file, which are those of the polygons, are not read.
"""

from collections import Counter
from collections.abc import Iterator
from functools import partial, reduce
from operator import or_
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.files import read_json
from egosplat.frames.recording import AnnotationKeys, Annotations
from egosplat_rivals.formats.labeled_annotations import LabeledObject, annotate, find_labels, open_labeled

_LEAST_POINTS = 3
# A polygon's points lie in its picture; what lies far outside is in another unit.
_MOST_PX = 2**20


open_recording = partial(open_labeled, "lerf")


def open_annotations(path: Path, keys: AnnotationKeys) -> Annotations:
    """Read the labels of a scene; UserError if there are none, one is damaged or of another size, or a polygon is none."""
    labels = find_labels("lerf", path)
    read = {label: _read_label(label) for label in labels.values()}
    counts = [Counter(category for category, _ in objects) for _, objects in read.values()]
    categories = sorted(reduce(or_, counts).elements())

    def objects_of(label: Path, size: tuple[int, int]) -> list[LabeledObject]:
        labeled_size, objects = read[label]
        if labeled_size != size:
            raise UserError(
                f"{label}: for a picture of {labeled_size[0]}x{labeled_size[1]} px, which has {size[0]}x{size[1]}. Give the "
                "pictures that were labeled, at their size."
            )
        return list(_painted(objects, categories, size))

    return annotate(path, keys, labels, categories, objects_of)


Polygon = tuple[str, NDArray[np.int32]]


def _read_label(path: Path) -> tuple[tuple[int, int], list[Polygon]]:
    """Width and height of the picture [px], and category and (P, 2) int32 points of each object."""
    try:
        document = read_json(path)
        size = int(document["info"]["width"]), int(document["info"]["height"])
        objects = [_read_object(path, number, one) for number, one in enumerate(document["objects"])]
    except (OSError, ValueError, TypeError, KeyError, OverflowError) as error:
        raise UserError(
            f"{path}: not a label of LERF-OVS ({repr(error)[:200]}). Download it again."
        ) from error
    if not objects:
        raise UserError(f"{path}: labels no object. Remove it; its picture is then no evaluation frame.")
    return size, objects


def _read_object(path: Path, number: int, entry: Any) -> Polygon:
    category = entry["category"]
    if not (isinstance(category, str) and category.strip()):
        raise UserError(f"{path}: objects[{number}]: category is {category!r}. Name what it is.")
    points = np.array(entry["segmentation"], np.float64).reshape(-1, 2)
    if len(points) < _LEAST_POINTS:
        raise UserError(
            f"{path}: objects[{number}] ({category}): segmentation has {len(points)} points; a polygon has {_LEAST_POINTS} or "
            "more. Draw it, or remove the object."
        )
    if not (np.abs(points) < _MOST_PX).all():
        raise UserError(f"{path}: objects[{number}] ({category}): a point of segmentation is no pixel.")
    # Cut off, not rounded, as LangSplat does.
    return category.strip(), points.astype(np.int32)


def _painted(objects: list[Polygon], categories: list[str], size: tuple[int, int]) -> Iterator[LabeledObject]:
    """Index and mask of each object of a picture."""
    seen: Counter[str] = Counter()
    for category, points in objects:
        mask = np.zeros(size[::-1], np.uint8)
        cv2.fillPoly(mask, [points], 1)
        yield categories.index(category) + seen[category], mask > 0
        seen[category] += 1

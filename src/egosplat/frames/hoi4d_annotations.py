"""Read HOI4D's motion segmentation: hands and handled objects. For evaluation only.

Masks are RGB images in ``2Dseg/shift_mask`` or ``2Dseg/mask``, 15 per second, from ``00000.png`` for the first frame.
Their colors are those of ``voc_color_map``. The meaning of labels 1, 2, … depends on the object category (the
dataset's ``definitions/motion segmentation/label.csv``).
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.files import find_masks, find_sequence, sequence_parts
from egosplat.errors import UserError
from egosplat.frames.images import read_rgb
from egosplat.frames.keys import AnnotationKeys
from egosplat.frames.recording import Instance
from egosplat.images import resize_labels

MASKS_PER_SECOND = 15

_LABELS: dict[str, tuple[str, ...]] = {
    "C1": ("toy car", "right hand"),
    "C2": ("mug", "right hand", "mug"),
    "C3": ("screen", "right hand", "keyboard"),
    "C4": ("door", "right hand", "body of the cabinet", "drawer", "bottle"),
    "C5": ("bottle", "right hand", "mug"),
    "C6": ("body of the safe", "right hand", "door", "bottle"),
    "C7": ("bowl", "right hand", "ball"),
    "C8": ("body of the bucket", "right hand", "handle", "body of the bucket", "handle", "left hand"),
    "C9": ("left part of the scissors", "right hand", "right part of the scissors"),
    "C11": ("left part of the pliers", "right hand", "right part of the pliers"),
    "C12": ("kettle", "right hand", "mug"),
    "C13": ("knife", "right hand", "apple"),
    "C14": ("body of the trash can", "right hand", "lid", "bottle"),
    "C17": ("base", "right hand", "tube", "top link", "bottom link", "left hand"),
    "C18": ("base", "right hand", "slot", "lid", "paper"),
    "C20": ("chair", "right hand", "left hand"),
}
_OBJECTS = {
    "C1": "toy car", "C2": "mug", "C3": "laptop", "C4": "storage furniture", "C5": "bottle", "C6": "safe",
    "C7": "bowl", "C8": "bucket", "C9": "scissors", "C11": "pliers", "C12": "kettle", "C13": "knife",
    "C14": "trash can", "C17": "lamp", "C18": "stapler", "C20": "chair",
}  # fmt: skip
_MAX_LABEL = 6
# The dataset's own tools ignore colors of no label; more than this share means another kind of image.
_MAX_UNKNOWN_SHARE = 0.01


def open_annotations(path: Path, keys: AnnotationKeys) -> "Hoi4dAnnotations | None":
    """Open the masks of a sequence; None if it has none."""
    folder = find_sequence(path)
    masks = find_masks(folder)
    return Hoi4dAnnotations(folder, masks, keys) if masks else None


class Hoi4dAnnotations:
    """The annotations of one sequence; an ``Annotations``. Instance ids are the dataset's labels 1 to 6."""

    def __init__(self, folder: Path, masks: Path, keys: AnnotationKeys) -> None:
        """Take the folders of a sequence and of its masks; UserError if the object category is unknown."""
        self._masks, self._camera, self._max_age_ns = masks, keys.camera, keys.max_age_ns
        self.instances = instances_of(sequence_parts(folder)[2], folder)

    def instance_map(self, timestamp_ns: int) -> NDArray[np.int32] | None:
        """See ``Annotations.instance_map``; UserError if the mask is unreadable, or of another shape or other colors."""
        number = round(timestamp_ns * MASKS_PER_SECOND / 1e9)
        path = self._masks / f"{number:05d}.png"
        age_ns = abs(timestamp_ns - round(number * 1e9 / MASKS_PER_SECOND))
        if age_ns > self._max_age_ns or not path.is_file():
            return None
        labels = decode_labels(read_rgb(path))
        if (unknown := float((labels < 0).mean())) > _MAX_UNKNOWN_SHARE:
            raise UserError(
                f"{path}: {unknown:.0%} of the pixels have a color of no HOI4D label. Download it again."
            )
        height, width = labels.shape
        if abs(height * self._camera.width - width * self._camera.height) > max(width, self._camera.width):
            raise UserError(
                f"{path}: {width}x{height} px has another aspect ratio than the video. Download it again."
            )
        resized = resize_labels(labels, self._camera.width, self._camera.height)
        return np.where(resized > 0, resized - 1, -1).astype(np.int32)


def instances_of(category: str, folder: Path) -> list[Instance]:
    """The instances of labels 1 to 6 of a category ``C1`` … ``C20``; UserError if HOI4D has no such category."""
    if category not in _OBJECTS:
        raise UserError(f"{folder}: {category} is not an object category of HOI4D.")
    # A label without a documented meaning gets the name of the object. HOI4D labels only what moves or is moved.
    meanings = (*_LABELS[category], *[_OBJECTS[category]] * _MAX_LABEL)[:_MAX_LABEL]
    return [
        Instance(
            label,
            f"{meaning.title().replace(' ', '')}_{label}",
            meaning,
            "dynamic",
            "human" if meaning.endswith(" hand") else "object",
        )
        for label, meaning in enumerate(meanings, start=1)
    ]


def voc_color_map(count: int = 256) -> NDArray[np.uint8]:
    """The PASCAL VOC palette: (count, 3) uint8 RGB of each label."""
    labels = np.arange(count, dtype=np.uint8)
    palette = np.zeros((count, 3), dtype=np.uint8)
    # Bits 0, 3, 6 of a label become the highest bits of red, in this order; bits 1, 4, 7 of green; bits 2, 5 of blue.
    for bit in range(8):
        palette[:, bit % 3] |= ((labels >> bit) & 1) << (7 - bit // 3)
    return palette


def decode_labels(mask: NDArray[np.uint8]) -> NDArray[np.int64]:
    """(H, W, 3) uint8 RGB mask -> (H, W) int64 labels 0 (none) to 6; -1 for other colors."""
    palette = _packed(voc_color_map(_MAX_LABEL + 1))
    order = np.argsort(palette)
    packed = _packed(mask)
    position = np.searchsorted(palette[order], packed).clip(max=_MAX_LABEL)
    return np.where(palette[order][position] == packed, order[position], -1)


def _packed(colors: NDArray[np.uint8]) -> NDArray[np.int64]:
    """(..., 3) RGB -> (...) one integer per color."""
    return colors.astype(np.int64) @ np.array([1 << 16, 1 << 8, 1])

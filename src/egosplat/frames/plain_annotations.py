"""Read the annotations of plain recordings (docs/recordings.md). For evaluation only.

The folder ``annotations/`` (of a video: ``clip.mp4.annotations/``) holds:

- ``instances.tsv``: a tab-separated table with a header and one line per instance. Columns: ``id`` (1..65535,
  unique), ``name``, ``category`` (the phrase of its query), ``motion_type`` (``static`` or ``dynamic``) and,
  optionally, ``instance_type`` (``object``, the default, or ``human``).
- one PNG for each annotated frame, in full size, with a single channel: 8-bit gray, 8-bit palette (indices, not
  colors) or 16-bit gray. Pixels hold the ``id`` of their instance, or 0. The PNG has the name of its image
  (``img_7.png`` for ``img_7.jpg``), or the number of the video frame from 0 (``12.png`` or ``00012.png``).
"""

import csv
import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.files import ANNOTATIONS, INSTANCES_TABLE, companion_path, is_annotated, list_masks
from egosplat.errors import UserError
from egosplat.files import read_user_text
from egosplat.frames.images import ImageFolder, open_image
from egosplat.frames.keys import AnnotationKeys
from egosplat.frames.labels import fit_labels
from egosplat.frames.recording import Instance
from egosplat.frames.video import Video, open_source

_COLUMNS = ("id", "name", "category", "motion_type")
# PIL's modes of one channel; a palette image holds indices, which are the ids.
_ONE_CHANNEL = ("1", "L", "P", "I;16", "I;16L", "I;16B", "I")
_MAX_ID = 65535
_NO_INSTANCE, _UNKNOWN_ID = -1, -2


def open_annotations(path: Path, keys: AnnotationKeys) -> "PlainAnnotations | None":
    """Open the annotations of a recording; None without any, UserError if it is missing or they are damaged."""
    if not path.exists():
        raise UserError(f"{path}: not found. Give a video file or an image folder.")
    return PlainAnnotations(path, keys) if is_annotated("plain", path) else None


class PlainAnnotations:
    """The annotations of a plain recording; an ``Annotations``."""

    def __init__(self, path: Path, keys: AnnotationKeys) -> None:
        """Read the table and list the annotated frames; UserError if it is unreadable, or a PNG belongs to no frame."""
        folder = companion_path(path, ANNOTATIONS)
        self.instances = read_instances(folder / INSTANCES_TABLE)
        self._keys = keys
        source = open_source(path, keys.originals.known_poses)
        if isinstance(source, ImageFolder) and keys.originals.turned:
            source.turn()
        self._sizes = dict(zip(source.timestamp_ns.tolist(), source.sizes, strict=True))
        self._pngs = _png_of_timestamp(folder, source)
        self._index_of_id = np.full(_MAX_ID + 1, _UNKNOWN_ID, dtype=np.int32)
        self._index_of_id[0] = _NO_INSTANCE
        self._index_of_id[[instance.id for instance in self.instances]] = np.arange(len(self.instances))

    def instance_map(self, timestamp_ns: int) -> NDArray[np.int32] | None:
        """See ``Annotations.instance_map``; UserError if the PNG is unreadable or of a wrong size, or an id unknown."""
        path = self._pngs.get(int(timestamp_ns))
        if path is None:
            return None
        ids = _read_ids(path)
        if ids.shape[::-1] != (size := self._sizes[int(timestamp_ns)]):
            raise UserError(
                f"{path}: {ids.shape[1]}x{ids.shape[0]} px, but the frame is {size[0]}x{size[1]}."
            )
        index = self._index_of_id[ids]
        if len(unknown := ids[index == _UNKNOWN_ID]):
            raise UserError(f"{path}: instance id {unknown[0]} is not in {INSTANCES_TABLE}. Add it there.")
        return fit_labels(index, int(timestamp_ns), self._keys)


def read_instances(path: Path) -> list[Instance]:
    """Read ``instances.tsv`` in its order; UserError if it is unreadable, lacks a column, or has a bad line."""
    try:
        reader = csv.DictReader(io.StringIO(read_user_text(path), newline=""), delimiter="\t")
        columns, lines = reader.fieldnames or [], list(reader)
    except (OSError, csv.Error) as error:
        raise UserError(f"{path}: not a readable table ({error}).") from error
    if missing := [column for column in _COLUMNS if column not in columns]:
        raise UserError(
            f"{path}: has no column {missing[0]!r}; it needs {', '.join(_COLUMNS)}, separated by tabs."
        )
    instances, first_line = [], {}
    for number, line in enumerate(lines, start=2):
        instances.append(instance := _instance(f"{path}: line {number}", line))
        if first_line.setdefault(instance.id, number) != number:
            raise UserError(f"{path}: id {instance.id} is in lines {first_line[instance.id]} and {number}.")
    return instances


def _instance(where: str, line: dict[str, str | None]) -> Instance:
    def field(column: str, allowed: tuple[str, ...] = (), default: str = "") -> str:
        value = (line.get(column) or default).strip()
        if not value or (allowed and value not in allowed):
            listed = f", not {' or '.join(allowed)}" if allowed else ""
            raise UserError(f"{where}: {column} is {value!r}{listed}.")
        return value

    text = field("id")
    if not (text.isascii() and text.isdigit() and len(text) < 10 and 1 <= int(text) <= _MAX_ID):
        raise UserError(f"{where}: id is {text[:40]!r}, not a whole number from 1 to {_MAX_ID}.")
    return Instance(
        int(text),
        field("name"),
        field("category"),
        field("motion_type", ("static", "dynamic")),
        field("instance_type", ("object", "human"), default="object"),
    )


def _png_of_timestamp(folder: Path, source: Video | ImageFolder) -> dict[int, Path]:
    """The PNG of each annotated frame by the frame's timestamp."""
    is_video = isinstance(source, Video)
    names = range(len(source.timestamp_ns)) if is_video else [image.stem for image in source.paths]
    numbers: dict[int | str, int] = {name: number for number, name in enumerate(names)}
    if len(numbers) < len(names):
        raise UserError(
            f"{folder}: pictures of several folders share names, so annotations cannot tell them apart."
        )
    pngs: dict[int, Path] = {}
    for path in list_masks(folder):
        is_number = path.stem.isascii() and path.stem.isdigit()
        key = int(path.stem) if is_video and is_number else path.stem
        if key not in numbers:
            raise UserError(f"{path}: {source.path} has no frame of this name. Rename or remove it.")
        timestamp = int(source.timestamp_ns[numbers[key]])
        if timestamp in pngs:
            raise UserError(f"{path}: annotates the same frame as {pngs[timestamp].name}. Remove one.")
        pngs[timestamp] = path
    return pngs


def _read_ids(path: Path) -> NDArray[np.int64]:
    with open_image(path) as image:
        if image.mode not in _ONE_CHANNEL:
            raise UserError(f"{path}: pixels of type {image.mode}; use a single channel of 8 or 16 bits.")
        ids = np.array(image).astype(np.int64)
    if ids.min() < 0 or ids.max() > _MAX_ID:
        raise UserError(f"{path}: pixel values outside 0..{_MAX_ID}.")
    return ids

"""Read the annotations of plain recordings (docs/recordings.md). For evaluation only."""

import csv
import io
from pathlib import Path
from unicodedata import normalize

import numpy as np

from egosplat.arrays import Ints, Ints32
from egosplat.calibration.files import ANNOTATIONS, INSTANCES_TABLE, companion_path, is_annotated, list_masks
from egosplat.errors import UserError
from egosplat.files import read_user_text
from egosplat.frames.images import Source, open_image
from egosplat.frames.recording import AnnotationKeys, Annotations, Instance, check_instance
from egosplat.frames.video import open_source

_COLUMNS = ("id", "name", "category", "motion_type")
# PIL's modes of one channel; a palette image holds indices, which are the ids.
_ONE_CHANNEL = ("1", "L", "P", "I;16", "I;16L", "I;16B", "I")
_MAX_ID = 65535
_UNKNOWN_ID = -2


def open_annotations(path: Path, keys: AnnotationKeys) -> Annotations | None:
    """Open the annotations of a recording; None without any, UserError if it is missing or they are damaged. Maps are read with
    UserError if the PNG is unreadable or of another size than its frame, or an id is not in the table."""
    if not path.exists():
        raise UserError(f"{path}: not found. Give a video file or an image folder.")
    if not is_annotated("plain", path):
        return None
    folder = companion_path(path, ANNOTATIONS)
    instances = read_instances(folder / INSTANCES_TABLE)
    source = open_source(path, keys.known_poses, turned=keys.turned)
    times, pngs = source.timestamp_ns.tolist(), _match(folder, source)
    annotated = {times[frame]: (png, source.sizes[frame]) for frame, png in pngs.items()}
    index_of_id = np.full(_MAX_ID + 1, _UNKNOWN_ID, dtype=np.int32)
    index_of_id[[0, *(instance.id for instance in instances)]] = np.arange(-1, len(instances))

    def read(timestamp_ns: int) -> Ints32 | None:
        if timestamp_ns not in annotated:
            return None
        png, (width, height) = annotated[timestamp_ns]
        if (ids := _read_ids(png)).shape != (height, width):
            raise UserError(f"{png}: {ids.shape[1]}x{ids.shape[0]} px, but the frame is {width}x{height}.")
        index = index_of_id[ids]
        if len(unknown := ids[index == _UNKNOWN_ID]):
            raise UserError(f"{png}: instance id {unknown[0]} is not in {INSTANCES_TABLE}. Add it there.")
        return keys.fit(index, timestamp_ns)[None]

    return Annotations(instances, read)


def read_instances(path: Path) -> list[Instance]:
    """Read ``instances.tsv`` in its order; UserError if it is unreadable, lacks a column, or has a bad line."""
    try:
        reader = csv.DictReader(io.StringIO(read_user_text(path), newline=""), delimiter="\t")
        columns, lines = reader.fieldnames or [], [(reader.line_num, line) for line in reader]
    except (OSError, csv.Error) as error:
        raise UserError(f"{path}: not a readable table ({error}).") from error
    if missing := [column for column in _COLUMNS if column not in columns]:
        raise UserError(f"{path}: has no column {missing[0]!r} of {', '.join(_COLUMNS)}, separated by tabs.")
    instances, line_of = [], {}
    for number, line in lines:
        where, cells = f"{path}: line {number}", {"instance_type": "object"}
        cells |= {column: text.strip() for column in columns if (text := line[column])}
        if empty := [column for column in _COLUMNS if not cells.get(column)]:
            raise UserError(f"{where}: {empty[0]} is ''.")
        text = cells["id"]
        identity = int(text) if text.isascii() and text.isdigit() and len(text) < 10 else text
        entry = {**cells, "id": identity}
        instances.append(check_instance(where, entry, (*_COLUMNS, "instance_type"), _MAX_ID))
        if line_of.setdefault(identity, number) != number:
            raise UserError(f"{path}: id {identity} is in lines {line_of[identity]} and {number}.")
    return instances


def _match(folder: Path, source: Source) -> dict[int, Path]:
    """The PNG of each annotated frame."""
    frames = {normalize("NFC", Path(name).stem): frame for frame, name in enumerate(source.names)}
    if len(frames) < len(source.names):
        raise UserError(f"{folder}: pictures of several folders share names. Rename them.")
    pngs: dict[int, Path] = {}
    for path in list_masks(folder):
        is_number = source.path.is_file() and path.stem.isascii() and path.stem.isdigit()
        frame = frames.get(str(int(path.stem)) if is_number else normalize("NFC", path.stem))
        if frame is None:
            raise UserError(f"{path}: {source.path} has no frame of this name. Rename or remove it.")
        if pngs.setdefault(frame, path) is not path:
            raise UserError(f"{path}: annotates the same frame as {pngs[frame].name}. Remove one.")
    return pngs


def _read_ids(path: Path) -> Ints:
    with open_image(path) as image:
        if image.mode not in _ONE_CHANNEL:
            raise UserError(f"{path}: pixels of type {image.mode}; use a single channel of 8 or 16 bits.")
        ids = np.array(image).astype(np.int64)
    if ids.min() < 0 or ids.max() > _MAX_ID:
        raise UserError(f"{path}: pixel values outside 0..{_MAX_ID}.")
    return ids

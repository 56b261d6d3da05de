"""Open the annotations of a recording by the name of its format. For evaluation only."""

from pathlib import Path

from egosplat.errors import UserError
from egosplat.frames import adt_annotations, hoi4d_annotations, plain_annotations
from egosplat.frames.hoi4d import find_sequence
from egosplat.frames.readers import FORMATS
from egosplat.frames.recording import Annotations
from egosplat.frames.recording_files import is_annotated
from egosplat.geometry import Camera


def open_annotations(
    format: str, path: Path, *, camera: Camera, upright: bool, max_age_ns: int = 3_000_000
) -> Annotations | None:
    """Open the annotations of a recording; None if it has none.

    Args:
        format, path, upright: as for the frames, see ``readers.open_recording``.
        camera: of the frames (``Capture.camera``).
        max_age_ns: largest time between a frame and its annotation; unused for plain recordings, which annotate
            frames by name.

    Raises:
        UserError: the format is unknown, the recording missing, or its annotations unreadable.
    """
    match format:
        case "adt":
            if not path.is_dir():
                raise UserError(f"{path}: no such folder. Give the folder of an ADT sequence.")
            if adt_annotations.find_segmentation(path) is None:
                return None
            return adt_annotations.AdtAnnotations(path, camera=camera, upright=upright, max_age_ns=max_age_ns)
        case "hoi4d":
            if hoi4d_annotations.find_masks(find_sequence(path)) is None:
                return None
            return hoi4d_annotations.Hoi4dAnnotations(path, camera=camera, max_age_ns=max_age_ns)
        case "plain":
            if not path.exists():
                raise UserError(f"{path}: not found. Give a video file or an image folder.")
            if not is_annotated(format, path):
                return None
            return plain_annotations.PlainAnnotations(path, camera=camera)
    raise UserError(f"format: {format!r} is unknown; choose from {', '.join(FORMATS)}.")

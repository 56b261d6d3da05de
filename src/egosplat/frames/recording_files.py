"""Facts about a recording that its file names and metadata tell: companion files, annotations, origin."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

from egosplat.calibration.companions import companion_path
from egosplat.errors import UserError
from egosplat.files import read_json

if TYPE_CHECKING:
    from egosplat.frames.recording import Origin

# Folder with the annotations of a plain recording.
ANNOTATIONS = "annotations"

# Facts about an ADT sequence, such as its origin.
METADATA = "metadata.json"


def is_annotated(format: str, path: Path) -> bool:
    """Whether a recording comes with annotations, judged without reading them.

    ADT and HOI4D recordings do. A plain recording does if its annotations folder exists.
    """
    # A broken link counts as present: the annotations stage then reports it.
    return format != "plain" or os.path.lexists(companion_path(path, ANNOTATIONS))


def recording_origin(format: str, recording: Path) -> "Origin":
    """``synthetic`` for an ADT sequence that egosplat rendered, according to its ``metadata.json``; else ``real``.

    Raises:
        UserError: ``metadata.json`` cannot be read.
    """
    path = recording / METADATA
    if format != "adt" or not os.path.lexists(path):
        return "real"
    try:
        metadata = read_json(path)
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: not readable as JSON ({error}). Download it again.") from error
    return "synthetic" if isinstance(metadata, dict) and metadata.get("origin") == "synthetic" else "real"

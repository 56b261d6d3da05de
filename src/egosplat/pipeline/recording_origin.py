"""Whether a recording was filmed or rendered, as its metadata tell."""

import os
from pathlib import Path
from typing import Literal

from egosplat.calibration.files import METADATA
from egosplat.errors import UserError
from egosplat.files import read_json

Origin = Literal["real", "synthetic"]


def recording_origin(format: str, recording: Path) -> Origin:
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

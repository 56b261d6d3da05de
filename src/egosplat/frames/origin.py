"""Where a recording comes from: a camera, or this package's synthetic apartments."""

import os
from pathlib import Path

from egosplat.errors import UserError
from egosplat.files import read_json
from egosplat.frames.recording import Origin


def recording_origin(format: str, recording: Path) -> Origin:
    """``synthetic`` for an ADT sequence whose ``metadata.json`` says so, as this package's own do; else ``real``.

    Raises:
        UserError: ``metadata.json`` cannot be read.
    """
    path = recording / "metadata.json"
    if format != "adt" or not os.path.lexists(path):
        return "real"
    try:
        metadata = read_json(path)
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: not readable as JSON ({error}). Download it again.") from error
    return "synthetic" if isinstance(metadata, dict) and metadata.get("origin") == "synthetic" else "real"

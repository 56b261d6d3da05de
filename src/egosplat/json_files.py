"""JSON files that come from elsewhere."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any


def read_json_file(path: Path, parse_constant: Callable[[str], Any] | None = None) -> Any:
    """The content of a JSON file, in UTF-8.

    Args:
        path: the file.
        parse_constant: see ``json.loads``.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no JSON, or nested so deeply that it is none that anyone means.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"), parse_constant=parse_constant)
    except RecursionError:
        raise ValueError("nested too deeply") from None

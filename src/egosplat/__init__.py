"""egosplat: ask questions in words of a 3D scene filmed from someone's head (docs/python.md)."""

import os
import re
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.3.0"

# torch reads it on import. Waiting threads that spin made training on two shared cores 3 to 7 times slower.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

# The stub names the public names by module. A module is imported on first use, so that ``import egosplat`` takes no time.
_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_PLACES = {name: module for module, name in re.findall(r"^from (\S+) import (\w+) as", _STUB, re.MULTILINE)}

__all__ = ["__version__", *_PLACES]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    """Import a public name."""
    if name not in _PLACES:
        raise AttributeError(f"module 'egosplat' has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

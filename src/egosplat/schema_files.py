"""The schemas that come with egosplat, and jsonschema to check against them.

jsonschema brings a check of every format that a library is there for. That of ``rfc3987_syntax`` builds a grammar when it
is imported, for a second, and no schema here names a format: so it counts as absent while jsonschema is imported.
"""

import functools
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from typing import Any

import yaml


@contextmanager
def _absent(name: str) -> Iterator[None]:
    """While this holds, an import of the module fails, unless it was imported before."""
    hidden = name not in sys.modules
    if hidden:
        sys.modules[name] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        if hidden:
            del sys.modules[name]


with _absent("rfc3987_syntax"):
    from jsonschema import Draft202012Validator, TypeChecker, ValidationError
    from jsonschema.validators import extend

__all__ = ["Draft202012Validator", "TypeChecker", "ValidationError", "extend", "schema"]


@functools.cache
def schema(name: str) -> dict[str, Any]:
    """The schema of that name: ``config``, ``scenes``, or that of a JSON file."""
    return yaml.safe_load((resources.files("egosplat") / "schemas" / f"{name}.schema.yaml").read_text())

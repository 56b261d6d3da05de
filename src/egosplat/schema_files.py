"""The schemas that come with egosplat: of the configuration, of the table of scenes, and of JSON files."""

import functools
from importlib import resources
from typing import Any

import yaml


@functools.cache
def schema(name: str) -> dict[str, Any]:
    """The schema of that name: ``config``, ``scenes``, or that of a JSON file."""
    return yaml.safe_load((resources.files("egosplat") / "schemas" / f"{name}.schema.yaml").read_text())

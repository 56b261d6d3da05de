"""YAML of configuration files and of values on a command line: a repeated key is an error, and 1e-4 is a number."""

import json
import re
from pathlib import Path
from typing import Any

import yaml

from egosplat.errors import UserError
from egosplat.files import read_user_text

# Errors of PyYAML. It raises ValueError for impossible dates and for numbers with too many digits.
NO_YAML = (yaml.YAMLError, ValueError, RecursionError)

# Numbers that YAML 1.1, and so PyYAML, reads as strings: no decimal point, or no sign of the exponent.
_EXPONENT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$")


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader with these two changes."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Construct a mapping, unless a key is repeated (yaml.constructor.ConstructorError)."""
        seen = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                why = f"key {key.value!r} is set twice; remove one"
                raise yaml.constructor.ConstructorError(None, None, why, key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _EXPONENT, list("-+.0123456789"))


def load_yaml(text: str) -> Any:
    """Load YAML, or JSON, which may hold tabs; no code is executed (NO_YAML, which ``problem`` describes)."""
    try:
        return json.loads(text, object_pairs_hook=_unique)
    except ValueError:  # YAML, or JSON with a repeated key
        return yaml.load(text, Loader=_Loader)  # noqa: S506: a safe loader


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len(found := dict(pairs)) < len(pairs):
        raise ValueError
    return found


def problem(error: Exception) -> str:
    """Describe one of ``NO_YAML``, with line and column if they are known."""
    if isinstance(error, yaml.MarkedYAMLError) and (mark := error.problem_mark):
        return f"line {mark.line + 1}, column {mark.column + 1}: {error.problem}"
    return str(error).partition("\n")[0]


def parse_value(text: str, where: str) -> Any:
    """Parse a value as YAML (UserError: it is not YAML)."""
    try:
        return load_yaml(text)
    except NO_YAML as error:
        raise UserError(f"{where}: its value cannot be read ({problem(error)})") from None


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a configuration file.

    Raises:
        UserError: the file is missing, is a pipe, is neither JSON nor YAML (names line and column), repeats a key, or is
            not a mapping.
    """
    try:
        content = load_yaml(read_user_text(path))
    except FileNotFoundError:
        raise UserError(f"{path}: does not exist. Give the path of a configuration file") from None
    except NO_YAML as error:
        raise UserError(f"{path}: cannot be read as YAML ({problem(error)})") from None
    if not isinstance(content, dict | None):
        raise UserError(f"{path}: holds {type(content).__name__}, needs keys with values")
    return content or {}

"""YAML of configuration files and of values on a command line: a repeated key is an error, and 1e-4 is a number."""

import re
from pathlib import Path
from typing import Any

import yaml

from egosplat.errors import UserError
from egosplat.files import read_user_text

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
    """Load YAML, without executing code (ValueError: it is none; with line and column if they are known)."""
    try:
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # impossible dates are ValueError
        why = str(error).partition("\n")[0]
        if isinstance(error, yaml.MarkedYAMLError) and (mark := error.problem_mark):
            why = f"line {mark.line + 1}, column {mark.column + 1}: {error.problem}"
        raise ValueError(why) from None


def parse_value(text: str, where: str) -> Any:
    """Parse a value as YAML (UserError: it is not YAML)."""
    try:
        return load_yaml(text)
    except ValueError as error:
        raise UserError(f"{where}: its value cannot be read ({error})") from None


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a configuration file (UserError: it is missing, a pipe, no YAML, repeats a key, or is no mapping)."""
    try:
        content = load_yaml(read_user_text(path))
    except FileNotFoundError:
        raise UserError(f"{path}: does not exist. Give the path of a configuration file") from None
    except ValueError as error:
        raise UserError(f"{path}: cannot be read as YAML ({error})") from None
    if not isinstance(content, dict | None):
        raise UserError(f"{path}: holds {type(content).__name__}, needs keys with values")
    return content or {}

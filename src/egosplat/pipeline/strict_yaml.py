"""YAML without repeated keys, in which 1e-4 is a number, as in YAML 1.2."""

import re
from collections.abc import Hashable
from typing import Any

import yaml

# Errors of PyYAML. It raises ValueError for impossible dates and for numbers with too many digits.
NO_YAML = (yaml.YAMLError, ValueError, RecursionError)

# Numbers that YAML 1.1, and so PyYAML, reads as strings: no decimal point, or no sign of the exponent.
_EXPONENT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$")

_MERGE = "tag:yaml.org,2002:merge"


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader with these two changes."""

    def construct_mapping(self, node: yaml.Node, deep: bool = False) -> dict[Hashable, Any]:
        """Construct the mapping of a node.

        Raises:
            yaml.constructor.ConstructorError: a key is repeated.
        """
        if isinstance(node, yaml.MappingNode):
            _check_once(node)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _EXPONENT, list("-+.0123456789"))


def load_yaml(text: str) -> Any:
    """Load a YAML text. No code in it is executed.

    Raises:
        NO_YAML: the text is not YAML, or a mapping repeats a key; ``problem`` describes it.
    """
    return yaml.load(text, Loader=_Loader)  # noqa: S506: a safe loader


def problem(error: Exception) -> str:
    """Describe one of ``NO_YAML``, with line and column if they are known."""
    if isinstance(error, RecursionError):
        return "nested too deeply"
    mark = getattr(error, "problem_mark", None)
    if mark is None:
        return str(error).partition("\n")[0]
    parts = [error.context] if error.problem.startswith("but ") else []
    return f"line {mark.line + 1}, column {mark.column + 1}: {', '.join([*parts, error.problem])}"


def _check_once(node: yaml.MappingNode) -> None:
    first: dict[tuple[str, str], int] = {}
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode) or key.tag == _MERGE:
            continue
        mark = key.start_mark
        name = (key.tag, key.value)
        if name in first:
            raise yaml.constructor.ConstructorError(
                None, None, f"key {key.value!r} is set twice, first in line {first[name]}; remove one", mark
            )
        first[name] = mark.line + 1

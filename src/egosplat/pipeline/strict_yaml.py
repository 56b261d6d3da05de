"""YAML in which nothing means another thing than it seems to: no repeated keys, no octal numbers, 1e-4 is a number."""

import json
import re
from collections.abc import Hashable
from typing import Any

import yaml

# Errors of PyYAML. It raises ValueError for impossible dates and for numbers with too many digits.
NO_YAML = (yaml.YAMLError, ValueError, RecursionError)

# Numbers that YAML 1.1, and so PyYAML, reads as strings: no decimal point, or no sign of the exponent.
_EXPONENT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$")

_TAG = "tag:yaml.org,2002:"
_MERGE, _TEXT = f"{_TAG}merge", f"{_TAG}str"

# Integers that YAML 1.1 reads as octal and YAML 1.2 as decimal.
_OCTAL = re.compile(r"[-+]?0[0-9_]+")

# Most nodes of a text with its aliases spelled out: a few lines of aliases of aliases can stand for billions.
_LARGEST = 100_000


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader with these two changes."""

    def construct_mapping(self, node: yaml.Node, deep: bool = False) -> dict[Hashable, Any]:
        """Construct a mapping, unless a key is repeated, or no text (yaml.constructor.ConstructorError)."""
        if isinstance(node, yaml.MappingNode):
            _check_keys(node)
        return super().construct_mapping(node, deep)

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        """Construct an integer, unless it is octal in one version of YAML and decimal in another (the same error)."""
        if _OCTAL.fullmatch(node.value):
            raise _refusal(node, f"{node.value} is octal in YAML; write it without the leading 0")
        return super().construct_yaml_int(node)

    def get_single_node(self) -> yaml.Node | None:
        """Compose the only document, unless its aliases stand for too many nodes; one that holds itself recurses."""
        node = super().get_single_node()
        if node is not None and _count(node) > _LARGEST:
            raise _refusal(node, f"its aliases stand for more than {_LARGEST:,} values; write them out")
        return node


_Loader.add_implicit_resolver(f"{_TAG}float", _EXPONENT, list("-+.0123456789"))
_Loader.add_constructor(f"{_TAG}int", _Loader.construct_yaml_int)


def load_yaml(text: str) -> Any:
    """Load YAML or JSON, which may hold tabs; no code is executed (NO_YAML, which ``problem`` describes)."""
    try:
        return json.loads(text, object_pairs_hook=_unique)
    except ValueError:  # YAML, or JSON with a repeated key, whose line the loader of YAML names
        return yaml.load(text, Loader=_Loader)  # noqa: S506: a safe loader


def problem(error: Exception) -> str:
    """Describe one of ``NO_YAML``, with line and column if they are known."""
    if isinstance(error, RecursionError):
        return "nested too deeply"
    mark = getattr(error, "problem_mark", None)
    if mark is None:
        return str(error).partition("\n")[0]
    parts = [error.context] if error.problem.startswith("but ") else []
    tab = ["write blanks in place of tabs"] if "'\\t'" in error.problem else []
    return f"line {mark.line + 1}, column {mark.column + 1}: {', '.join([*parts, error.problem, *tab])}"


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key is repeated")
    return found


def _check_keys(node: yaml.MappingNode) -> None:
    first: dict[str, int] = {}
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode) or key.tag == _MERGE:
            continue
        if key.tag != _TEXT:
            kind = key.tag.removeprefix(_TAG)
            raise _refusal(key, f"key {key.value} is read as {kind}; put it in quotes")
        if key.value in first:
            raise _refusal(
                key, f"key {key.value!r} is set twice, first in line {first[key.value]}; remove one"
            )
        first[key.value] = key.start_mark.line + 1


def _refusal(node: yaml.Node, why: str) -> yaml.constructor.ConstructorError:
    return yaml.constructor.ConstructorError(None, None, why, node.start_mark)


def _count(node: yaml.Node) -> int:
    """Count the nodes below a node, aliases spelled out."""
    # By node, so that an alias of aliases is counted without being walked again; a node within itself recurses.
    counts: dict[int, int] = {}

    def visit(one: yaml.Node) -> int:
        if id(one) not in counts:
            inner = one.value if isinstance(one, yaml.CollectionNode) else []
            parts = [part for each in inner for part in (each if isinstance(each, tuple) else (each,))]
            counts[id(one)] = 1 + sum(map(visit, parts))
        return counts[id(one)]

    return visit(node)

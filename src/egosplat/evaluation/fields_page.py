"""Print docs/metrics.md, the fields of ``metrics.json``, from its schema: ``python -m egosplat.evaluation.fields_page``."""

from collections.abc import Iterator, Mapping
from typing import Any

from egosplat.pipeline.validation import schema

_ABOUT = """# Fields of metrics.json

`python -m egosplat.evaluation.fields_page` prints this page from [the schema](../src/egosplat/pipeline/schemas/metrics.schema.yaml), a JSON Schema
(2020-12) in YAML, against which each file is checked where it is written and where it is read. `null` is a number that is not defined. `[]`
stands for each entry of a list, `NAME` for each name. `format_version` rises by one with every change of a field ([CHANGELOG.md](../CHANGELOG.md));
a reader takes its own version alone. `commit` and `clean` are no input: a new commit makes nothing stale."""


def fields_page() -> str:
    """The page."""
    whole = schema("metrics")
    tables = [
        _table(name, part) for name, part in {None: whole, **whole["$defs"]}.items() if "properties" in part
    ]
    return "\n\n".join([_ABOUT, *tables]) + "\n"


def _table(name: str | None, part: Mapping[str, Any]) -> str:
    lines = ["| field | type | what |", "| --- | --- | --- |"]
    lines += [f"| `{path}` | {kind} | {about} |" for path, kind, about in _rows(part)]
    return "\n".join([*([f"## {name.capitalize()}", ""] if name else []), *lines])


def _rows(part: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str, str]]:
    """Path, type and description of each field of an object."""
    fields = dict(part.get("properties", {}))
    if isinstance(part.get("additionalProperties"), dict):
        fields["NAME"] = part["additionalProperties"]
    for key, field in fields.items():
        optional = "" if key in part.get("required", fields) or key == "NAME" else " (not always)"
        resolved, kind = _resolved(field)
        yield f"{above}{key}", kind + optional, resolved.get("description", "").strip()
        inner = resolved.get("items", resolved)
        yield from _rows(inner, f"{above}{key}{'[]' if inner is not resolved else ''}.")


def _resolved(field: Mapping[str, Any]) -> tuple[Mapping[str, Any], str]:
    """A field with its reference resolved, and its type in words. An object that is referred to has its own table."""
    if "$ref" not in field:
        return field, _kind(field)
    name = field["$ref"].rpartition("/")[2]
    target = schema("metrics")["$defs"][name]
    if "properties" in target:
        return field, f"[{name}](#{name})"
    return {**target, **field}, _kind(target)


def _kind(field: Mapping[str, Any]) -> str:
    if allowed := field.get("enum", [field["const"]] if "const" in field else []):
        return ", ".join("null" if one is None else str(one) for one in allowed)
    kinds = field["type"]
    return kinds if isinstance(kinds, str) else " or ".join(kinds)


if __name__ == "__main__":
    print(fields_page(), end="")

"""Texts that stand for a number, true, false or null, as Snakemake's ``--config`` and YAML 1.1 hand them on."""

import re
from collections.abc import Mapping
from typing import Any

from egosplat.pipeline.strict_yaml import NO_YAML, load_yaml
from egosplat.pipeline.validation import schema

Config = dict[str, Any]


_NAMED = ("variants", "formats")
"""Sections that hold whole sets of keys by name."""


def coerced(config: Mapping[str, Any]) -> Config:
    """A configuration whose texts are values of the type that the schema names, where they read as one.

    Snakemake hands ``--config splats={iterations: 5}`` on as the text ``5``, and a file's ``1e-4`` as a text too.
    What does not read so stays as it is, for the schema to refuse.
    """
    root = schema("config")
    found = _coerced(config, root)
    sections = {name: part for name, part in root["properties"].items() if name not in _NAMED}
    for named in _NAMED:
        if isinstance(sets := found.get(named), Mapping):
            found[named] = {name: _coerced(keys, {"properties": sections}) for name, keys in sets.items()}
    tradeoff = found.get("tradeoff")
    if isinstance(tradeoff, Mapping) and isinstance(knobs := tradeoff.get("sweep"), Mapping):
        found["tradeoff"] = {**tradeoff, "sweep": {key: _coerced_knob(key, knobs[key]) for key in knobs}}
    return found


def _coerced_knob(key: object, values: Any) -> Any:
    """The values of a knob, by the schema of the key that it names."""
    section, _, name = str(key).partition(".")
    part = schema("config")["properties"].get(section, {}).get("properties", {}).get(name, {})
    return _coerced(values, {"type": "array", "items": part})


def _coerced(value: Any, part: Mapping[str, Any]) -> Any:
    if isinstance(value, str):
        return _read(value, part)
    if isinstance(value, list) and "items" in part:
        return [_coerced(item, part["items"]) for item in value]
    if isinstance(value, Mapping) and part.keys() & {"properties", "additionalProperties"}:
        known, other = part.get("properties", {}), part.get("additionalProperties") or {}
        return {key: _coerced(item, known.get(key, other)) for key, item in value.items()}
    return value


def _read(text: str, part: Mapping[str, Any]) -> Any:
    kinds = part.get("type", "string")
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if text == "null" and "null" in kinds:
        return None
    if "string" in kinds and re.fullmatch(part.get("pattern", ".*"), text, re.DOTALL):
        return text
    try:
        return load_yaml(text)
    except NO_YAML:
        return text

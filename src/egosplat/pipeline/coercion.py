"""Conversion of strings to numbers, booleans and null, where Snakemake's ``--config`` and YAML 1.1 leave strings."""

import re
from collections.abc import Mapping
from typing import Any

from egosplat.pipeline.strict_yaml import NO_YAML, load_yaml
from egosplat.pipeline.validation import schema

Config = dict[str, Any]


_NAMED = ("variants", "formats")
"""Sections whose values are named sets of keys."""


def coerced(config: Mapping[str, Any]) -> Config:
    """Convert the strings of a configuration to the types in the schema.

    A string that cannot be converted stays, and validation rejects it.
    """
    # Snakemake passes the 5 of `--config splats={iterations: 5}` and the 1e-4 of a file as strings.
    root = schema("config")
    found = _coerced(config, root)
    sections = {name: part for name, part in root["properties"].items() if name not in _NAMED}
    for named in _NAMED:
        if isinstance(sets := found.get(named), Mapping):
            found[named] = {name: _coerced(keys, {"properties": sections}) for name, keys in sets.items()}
    tradeoff = found.get("tradeoff")
    if isinstance(tradeoff, Mapping) and isinstance(sweep := tradeoff.get("sweep"), Mapping):
        found["tradeoff"] = {**tradeoff, "sweep": {key: _coerced_sweep(key, sweep[key]) for key in sweep}}
    return found


def _coerced_sweep(key: object, values: Any) -> Any:
    """Convert the values of a swept key by the schema of that key."""
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

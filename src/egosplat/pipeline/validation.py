"""Validation of results against the JSON schemas of their files."""

import functools
from pathlib import Path
from typing import Any

import yaml
from jsonschema import Draft202012Validator

from egosplat.errors import UserError
from egosplat.files import read_users_json, write_json
from egosplat.pipeline.home import make_command
from egosplat.pipeline.messages import not_allowed, shorten


@functools.cache
def schema(name: str) -> dict[str, Any]:
    """Load the schema of a JSON file; an object has just the properties that it lists, all but those in ``optional``."""
    document = yaml.safe_load((Path(__file__).parent / "schemas" / f"{name}.schema.yaml").read_text())
    _close(document)
    return document


def _close(part: Any) -> None:
    """Spell out the rule of ``schema`` where an object does not say itself what it may lack or have besides."""
    if isinstance(part, dict) and "properties" in part and not {"additionalProperties", "required"} & {*part}:
        optional = part.pop("optional", [])
        part |= {"type": part.get("type", "object"), "additionalProperties": False}
        part["required"] = [name for name in part["properties"] if name not in optional]
    for inner in part.values() if isinstance(part, dict) else part if isinstance(part, list) else ():
        _close(inner)


def read_document(path: Path, name: str) -> dict[str, Any]:
    """Read a JSON result and check it against the schema ``name`` (UserError: the file is missing, is not
    JSON, or does not match the schema; says how to make it)."""
    again = f"Rebuild it: {make_command(path, flag='--force ')}"
    if not path.exists():
        raise UserError(f"{path}: does not exist. Make it: {make_command(path)}")
    document = read_users_json(path, f" {again}")
    for error in Draft202012Validator(schema(name)).iter_errors(document):
        why = f"its schema has {error.validator}: {shorten(error.validator_value)}"
        told = not_allowed(".".join(map(str, error.absolute_path)), error.instance, why)
        raise UserError(f"{path}: {told}.\n{again}")
    return document


def write_document(path: Path, document: dict[str, Any], name: str) -> None:
    """Check a JSON result against the schema ``name`` (jsonschema.ValidationError), and write it with sorted keys, whole or not
    at all."""
    Draft202012Validator(schema(name)).validate(document)
    write_json(path, document)

"""Validation against the JSON schemas of configuration, scenes and JSON artifacts, with errors in plain words."""

import difflib
import functools
import math
import re
import shlex
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from egosplat.errors import UserError
from egosplat.files import read_json


@contextmanager
def _absent(name: str) -> Iterator[None]:
    """Make imports of a module fail inside the context, unless it is already imported."""
    hidden = name not in sys.modules
    if hidden:
        sys.modules[name] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        if hidden:
            del sys.modules[name]


# jsonschema imports a checker for each format whose library is installed. rfc3987_syntax builds a grammar on import,
# which takes a second. No schema here uses a format.
with _absent("rfc3987_syntax"):
    from jsonschema import Draft202012Validator, TypeChecker, ValidationError
    from jsonschema.validators import extend

__all__ = [
    "LARGEST_INTEGER",
    "Draft202012Validator",
    "StrictValidator",
    "ValidationError",
    "explained",
    "read_document",
    "schema",
    "shortened",
]


@functools.cache
def schema(name: str) -> dict[str, Any]:
    """Load a schema: ``config``, ``scenes``, or that of a JSON file."""
    return yaml.safe_load((resources.files(__package__) / "schemas" / f"{name}.schema.yaml").read_text())


def read_document(path: Path, name: str) -> dict[str, Any]:
    """Read a JSON result and check it against the schema ``name``.

    Raises:
        UserError: the file is missing, is not JSON, or does not match the schema; says how to make it.
    """
    file = shlex.quote(str(path))
    again = f"Rebuild it: snakemake --cores 2 --force {file}"
    try:
        document = read_json(path, parse_constant=_refuse)
    except FileNotFoundError:
        raise UserError(f"{path}: does not exist. Make it: snakemake --cores 2 {file}") from None
    except (OSError, ValueError) as error:
        reason = str(error).partition("\n")[0]
        raise UserError(f"{path}: cannot be read as JSON ({reason}). {again}") from None
    version = schema(name)["properties"]["format_version"]["const"]
    found = document.get("format_version", version) if isinstance(document, dict) else version
    if found != version:
        raise UserError(
            f"{path}: has format {found!r}; this version of egosplat reads format {version}.\n{again}"
        )
    for error in Draft202012Validator(schema(name)).iter_errors(document):
        raise UserError(f"{path}: {explained(error)}.\n{again}")
    return document


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is no number of JSON")


# Largest integer that a key may have. Libraries accept no larger seeds.
LARGEST_INTEGER = 2**31 - 1


def _is_integer(_: TypeChecker, value: object) -> bool:
    # Unlike the standard type, 3.0 is rejected: the flags of stages do not accept it.
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) <= LARGEST_INTEGER


def _is_number(checker: TypeChecker, value: object) -> bool:
    # NaN would pass every bound, and infinity most of them.
    return _is_integer(checker, value) or (isinstance(value, float) and math.isfinite(value))


def _matches(
    _: Draft202012Validator, pattern: str, value: object, __: Mapping[str, Any]
) -> Iterator[ValidationError]:
    # fullmatch, because $ in Python also matches before a final newline.
    if isinstance(value, str) and not re.fullmatch(pattern, value):
        yield ValidationError(f"{value!r} does not match {pattern!r}")


# Accepts only finite numbers and 32-bit integers, and matches patterns against the whole string.
StrictValidator = extend(
    Draft202012Validator,
    validators={"pattern": _matches},
    type_checker=Draft202012Validator.TYPE_CHECKER.redefine_many(
        {"integer": _is_integer, "number": _is_number}
    ),
)

# Longest value in a message [characters].
_LONGEST = 80

# Names of JSON schema types in messages.
_KINDS = {
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
    "string": "a text",
    "array": "a list, as in [a, b]",
    "object": "keys with values",
    "null": "null",
}

# Messages by keyword of JSON schema.
_ALLOWED = {
    "minimum": "at least {}",
    "maximum": "at most {}",
    "exclusiveMinimum": "more than {}",
    "exclusiveMaximum": "less than {}",
    "multipleOf": "a multiple of {}",
    "minItems": "at least {} of them",
    "maxItems": "at most {} of them",
    "minProperties": "at least {} of them",
    "maxLength": "at most {} letters",
    "const": "only {}",
}

# Removed keys, with their replacement.
_REMOVED = {
    "budget": "set preset (docs/speed.md)",
    "transient.strategy": "3DGS's density control is the only strategy",
    "splats.strategy": "3DGS's density control is the only strategy (benchmarks/training/README.md)",
    "splats.patience": "training always runs to its end: stopping early bought nothing (benchmarks/tradeoff/README.md)",
    "splats.min_improvement": "training always runs to its end",
    "survey.max_moving_share": "survey.max_moving_probability decides now; its default suits most cameras",
}

# New names of renamed keys, by section and old name. Kept for one release.
_RENAMED = {
    "tradeoff.knobs": "sweep",
    "segments.min_uncovered": "min_uncovered_fraction",
    "segments.new_cover_thresh": "max_covered_new",
    "segments.share_iou": "cross_level_iou",
    "segments.absent_stride": "lost_track_stride",
    "features.renormalize": "normalize",
    "features.target": "supervision",
    "features.outliers": "outlier_target",
    "features.slipped": "mismatched_views",
    "transient.lambda2": "transient_penalty",
    "transient.cover": "densify_init",
    "splats.lambda1": "feature_weight",
    "splats.cover": "densify_init",
    "language.unit_codes": "normalize_codes",
    "query.smoothing": "box_filter",
    "query.majority": "majority_filter",
    "metrics.target": "hit_region",
}


def renamed(section: str, key: str) -> str | None:
    """Get the new name of a renamed key, or None."""
    return _RENAMED.get(f"{section}.{key}")


def explained(error: ValidationError) -> str:
    """Describe an error in one line: the key, its value, and what is allowed."""
    key = ".".join(str(part) for part in error.absolute_path)
    key = key if key.isprintable() and len(key) <= _LONGEST else shortened(key)
    if error.validator == "additionalProperties":
        return _unknown(error, key)
    return f"{key or 'value'} = {shortened(error.instance)} is not allowed: {_allowed(error, key)}"


def shortened(value: object) -> str:
    """Format a value on one line, cut to ``_LONGEST`` characters."""
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _unknown(error: ValidationError, key: str) -> str:
    known = list(error.schema["properties"])
    unknown = str(min(set(error.instance) - set(known), key=str))
    name, colon, value = unknown.partition(":")
    near = difflib.get_close_matches(name, known, n=1)
    section = key.rpartition(".")[2]
    if advice := _REMOVED.get(f"{section}.{unknown}" if key else unknown):
        return f"key '{key}{'.' if key else ''}{unknown}' was removed; {advice}"
    if new := renamed(section, unknown):
        return f"key '{key}.{unknown}' was renamed; write {new!r}"
    if colon and name in known:
        advice = f"write a space after the colon: {name}: {value[:_LONGEST]}"
    elif near:
        advice = f"did you mean {near[0]!r}?"
    else:
        advice = f"known keys: {', '.join(known)}"
    return f"unknown key {shortened(f'{key}.{unknown}' if key else unknown)}; {advice}"


def _allowed(error: ValidationError, key: str) -> str:
    limit, instance = error.validator_value, error.instance
    match error.validator:
        case "enum":
            near = difflib.get_close_matches(str(instance), map(str, limit), n=1)
            return f"one of {', '.join(map(str, limit))}" + (f" (did you mean {near[0]!r}?)" if near else "")
        case "type" if isinstance(instance, int) and abs(instance) > LARGEST_INTEGER:
            return f"at most {LARGEST_INTEGER}"
        case "type":
            return f"must be {_kind(limit, instance)}{_example(error.schema, key)}"
        case "pattern":
            return f"only {error.schema.get('allowed', limit)}"
        case "minLength":
            return "must not be empty"
        case "uniqueItems":
            return "no repeated items"
        case "required":
            return f"lacks {', '.join(sorted(set(limit) - set(instance)))}"
    wording = _ALLOWED.get(error.validator)
    return wording.format(limit) if wording else error.message[: 2 * _LONGEST]


def _kind(names: str | list[str], instance: object) -> str:
    """Describe the required type, with a hint for a number that is almost valid."""
    names = [names] if isinstance(names, str) else names
    text = " or ".join(_KINDS[name] for name in names)
    if not isinstance(instance, float):
        return text
    if not math.isfinite(instance):
        return f"{text}, and finite"
    return f"{text}, written {instance:.0f}" if instance.is_integer() and abs(instance) < 1e9 else text


def _example(part: Mapping[str, Any], key: str) -> str:
    """Show how a section is written, with its first key as the example."""
    for name, sub in part.get("properties", {}).items():
        if key and "default" in sub:
            value = yaml.safe_dump(sub["default"], default_flow_style=True).splitlines()[0]
            return f", as in {key}: {{{name}: {value}}}"
    return ""

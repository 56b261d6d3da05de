"""Validation: JSON schemas of configuration, scenes and JSON artifacts, and what is wrong with a value in words."""

import difflib
import functools
import math
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from typing import Any

import yaml


@contextmanager
def _absent(name: str) -> Iterator[None]:
    """While this holds, an import of the module fails, unless it was imported before."""
    hidden = name not in sys.modules
    if hidden:
        sys.modules[name] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        if hidden:
            del sys.modules[name]


# jsonschema imports a checker of each format whose library is installed. rfc3987_syntax builds a grammar on
# import, which takes a second; no schema here names a format.
with _absent("rfc3987_syntax"):
    from jsonschema import Draft202012Validator, TypeChecker, ValidationError
    from jsonschema.validators import extend

__all__ = [
    "LARGEST_INTEGER",
    "Draft202012Validator",
    "StrictValidator",
    "ValidationError",
    "explained",
    "schema",
    "shortened",
]


@functools.cache
def schema(name: str) -> dict[str, Any]:
    """The schema of that name: ``config``, ``scenes``, or that of a JSON file."""
    return yaml.safe_load((resources.files(__package__) / "schemas" / f"{name}.schema.yaml").read_text())


LARGEST_INTEGER = 2**31 - 1
"""That a key may have: libraries take no larger seeds, and nothing is counted further."""


def _is_integer(_: TypeChecker, value: object) -> bool:
    """Not 3.0 either, which no flag of a stage takes."""
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) <= LARGEST_INTEGER


def _is_number(checker: TypeChecker, value: object) -> bool:
    """NaN would pass every bound, and infinity most."""
    return _is_integer(checker, value) or (isinstance(value, float) and math.isfinite(value))


def _matches(
    _: Draft202012Validator, pattern: str, value: object, __: Mapping[str, Any]
) -> Iterator[ValidationError]:
    """The whole of a text: Python's $ lets a newline follow."""
    if isinstance(value, str) and not re.fullmatch(pattern, value):
        yield ValidationError(f"{value!r} does not match {pattern!r}")


StrictValidator = extend(
    Draft202012Validator,
    validators={"pattern": _matches},
    type_checker=Draft202012Validator.TYPE_CHECKER.redefine_many(
        {"integer": _is_integer, "number": _is_number}
    ),
)
"""Numbers are finite, whole ones of 32 bits and not written 3.0; a pattern is of the whole text."""


_LONGEST = 80
"""Of a value in a message [letters]."""

_KINDS = {
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
    "string": "a text",
    "array": "a list, as in [a, b]",
    "object": "keys with values",
    "null": "null",
}
"""By type of JSON schema: what it is called."""

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
    "const": "{} alone",
}
"""By keyword of JSON schema, with its value: what is allowed."""


_REMOVED = {"budget": "set preset to fast, balanced or paper (docs/speed.md)"}
"""Keys that earlier versions had, and what to use now."""

_RENAMED = {
    "tradeoff.knobs": "sweep",
    "segments.min_uncovered": "min_uncovered_fraction",
    "segments.new_cover_thresh": "max_covered_new",
    "segments.share_iou": "cross_level_iou",
    "segments.absent_stride": "lost_track_stride",
    "features.renormalise": "normalize",
    "features.target": "supervision",
    "features.outliers": "outlier_target",
    "features.slipped": "mismatched_views",
    "transient.lambda2": "transient_penalty",
    "transient.density": "strategy",
    "transient.cover": "densify_init",
    "splats.lambda1": "feature_weight",
    "splats.density": "strategy",
    "splats.cover": "densify_init",
    "language.unit_codes": "normalize_codes",
    "query.smoothing": "box_filter",
    "query.majority": "majority_filter",
    "metrics.target": "hit_region",
}
"""Keys by the name that they had before this version, with their new name; for one release."""


def renamed(section: str, key: str) -> str | None:
    """The new name of a key, by its section and the name that it had before this version."""
    return _RENAMED.get(f"{section}.{key}")


def explained(error: ValidationError) -> str:
    """Which key is wrong, its value, and what is allowed, in one line."""
    key = ".".join(str(part) for part in error.absolute_path)
    key = key if key.isprintable() and len(key) <= _LONGEST else shortened(key)
    if error.validator == "additionalProperties":
        return _unknown(error, key)
    return f"{key or 'value'} = {shortened(error.instance)} is not allowed: {_allowed(error, key)}"


def shortened(value: object) -> str:
    """A value as Python writes it, on one line and not for ever."""
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _unknown(error: ValidationError, key: str) -> str:
    known = list(error.schema["properties"])
    unknown = str(min(set(error.instance) - set(known), key=str))
    name, colon, value = unknown.partition(":")
    near = difflib.get_close_matches(name, known, n=1)
    if not key and unknown in _REMOVED:
        return f"key {unknown!r} was removed; {_REMOVED[unknown]}"
    if new := renamed(key.rpartition(".")[2], unknown):
        return f"key '{key}.{unknown}' was renamed; write {new!r}"
    if colon and name in known:
        advice = f"write a blank after the colon: {name}: {value[:_LONGEST]}"
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
            return "each may stand in it once"
        case "required":
            return f"lacks {', '.join(sorted(set(limit) - set(instance)))}"
    wording = _ALLOWED.get(error.validator)
    return wording.format(limit) if wording else error.message[: 2 * _LONGEST]


def _kind(names: str | list[str], instance: object) -> str:
    """What a value has to be, with what is missing of a number that nearly is one."""
    names = [names] if isinstance(names, str) else names
    text = " or ".join(_KINDS[name] for name in names)
    if not isinstance(instance, float):
        return text
    if not math.isfinite(instance):
        return f"{text}, and finite"
    return f"{text}, written {instance:.0f}" if instance.is_integer() and abs(instance) < 1e9 else text


def _example(part: Mapping[str, Any], key: str) -> str:
    """How keys with values are written, by the first that a section has."""
    for name, sub in part.get("properties", {}).items():
        if key and "default" in sub:
            value = yaml.safe_dump(sub["default"], default_flow_style=True).splitlines()[0]
            return f", as in {key}: {{{name}: {value}}}"
    return ""

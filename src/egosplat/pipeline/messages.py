"""What is wrong with a value, and what is allowed, on one line for people."""

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from typing import Any

import yaml
from pydantic import ValidationError

from egosplat.errors import UserError
from egosplat.pipeline.options import LARGEST_INTEGER, Options, full_names, keys_of

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
_LIMITS = {
    "minimum": "at least {}",
    "maximum": "at most {}",
    "exclusiveMinimum": "more than {}",
    "exclusiveMaximum": "less than {}",
    "multipleOf": "a multiple of {}",
    "minItems": "at least {} of them",
    "minLength": "not empty",
    "maxLength": "at most {} letters",
}


def make_options(options: type[Options], values: Mapping[str, Any], where: str, own: str) -> Options:
    """Make options, which checks the values and adds the defaults.

    Args:
        where: what gives the values, for messages.
        own: section of the keys that are in no shared one; empty for none.

    Raises:
        UserError: a key is unknown or has a forbidden value; names the first one.
    """
    try:
        return options.model_validate(values)
    except ValidationError as error:
        raise UserError(f"{where}: {refusal(error, values, options, own)}") from None


def refusal(error: ValidationError, given: Mapping[Any, Any], options: type[Options], own: str) -> str:
    """Describe the first error of options in one line: the key, its value, and what is allowed."""
    first, keys = error.errors(include_url=False)[0], keys_of(options)
    name, *steps = first["loc"]
    if name not in keys:
        return unknown_key("", name, list(keys))
    path, value = [full_names(options, own)[name]], given[name]
    for step in steps:  # pydantic adds names of types to the path, too
        items: Any = dict(enumerate(value)) if isinstance(value, list | tuple) else value
        if isinstance(items, Mapping) and step in items:
            path, value = [*path, str(step)], items[step]
    cause = first.get("ctx", {}).get("error")
    why = str(cause or first["msg"]) if cause or len(path) > 1 else allowed(keys[name], value)
    return not_allowed(".".join(path), value, why)


def not_allowed(key: str, value: object, why: str) -> str:
    """Say that a value is not allowed, and why."""
    key = key if key.isprintable() and len(key) <= _LONGEST else shorten(key)
    return f"{key or 'value'} = {shorten(value)} is not allowed: {why}"


def unknown_key(section: str, key: object, known: Sequence[str], homes: Sequence[str] = ()) -> str:
    """Say that there is no such key, with what is meant.

    Args:
        known: the keys of the section, which is empty outside sections.
        homes: full names of the keys of this name in sections.
    """
    full = f"{section}.{key}" if section else str(key)
    name, colon, value = str(key).partition(":")
    first, dot, rest = str(key).partition(".")
    if colon and name in known:
        advice = f"write a space after the colon: {name}: {value[:_LONGEST]}"
    elif homes:
        advice = f"did you mean {' or '.join(homes)}?"
    elif dot and first in known:
        advice = f"write {first}: {{{rest}: ...}}"
    elif near := difflib.get_close_matches(name, known, n=1):
        advice = f"did you mean {near[0]!r}?"
    else:
        advice = f"known keys: {', '.join(known)}"
    return f"unknown key {shorten(full)}; {advice}"


def allowed(part: Mapping[str, Any], value: object) -> str:
    """Say what a JSON schema of one key allows in place of a refused value."""
    near = difflib.get_close_matches(str(value), choices(part), n=1)
    largest = isinstance(value, int) and abs(value) > LARGEST_INTEGER
    text = f"must be {describe_value(part)}" + (f", at most {LARGEST_INTEGER}" if largest else "")
    return text + (f" (did you mean {near[0]!r}?)" if near else "")


def describe_value(part: Mapping[str, Any]) -> str:
    """Describe the values that a JSON schema of one key allows."""
    words, kinds = choices(part), kinds_of(part)
    if words and not kinds:
        return f"one of {', '.join(words)}"
    return ", ".join([" or ".join([*kinds, *words]), *limits_of(part)])


def choices(part: Mapping[str, Any]) -> list[str]:
    """List the words among the allowed values."""
    return [
        str(word)
        for one in _options(part)
        for word in one.get("enum", [one["const"]] if "const" in one else [])
    ]


def kinds_of(part: Mapping[str, Any]) -> list[str]:
    """List the allowed types, in words; a reference leads to the schema of an object."""
    others = [one for one in _options(part) if not {"enum", "const"} & one.keys()]
    types = ["object" if "$ref" in one else one.get("type") for one in others]
    return [_KINDS[kind] for one in types for kind in ([one] if isinstance(one, str) else one or [])]


def limits_of(part: Mapping[str, Any]) -> list[str]:
    """List the limits of numbers, texts and lists, in words."""
    return [
        text.format(one[word])
        for one in _options(part)
        for word, text in _LIMITS.items()
        if word in one and one[word] != LARGEST_INTEGER
    ]


def figure(value: float, form: str, is_beyond: Callable[[float], object]) -> str:
    """Format a number so that what is shown lies on the same side of a limit as the number itself.

    Args:
        form: format such as ``.2f`` or ``.1%``.
        is_beyond: tells on which side of the limit, or between which limits, a number lies.
    """
    text = format(value, form)
    if not math.isfinite(value):
        return text
    shown, scale = Decimal(text.rstrip("%")), 100 if text.endswith("%") else 1
    step = Decimal((0, (1,), int(shown.as_tuple().exponent)))
    near = (float(one) / scale for one in (shown, shown - step, shown + step))
    return format(next((one for one in near if is_beyond(one) == is_beyond(value)), value), form)


def shorten(value: object) -> str:
    """Format a value on one line, cut to ``_LONGEST`` characters."""
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def shown(value: Any) -> str:
    """Format a value as YAML on one line."""
    return yaml.safe_dump(value, default_flow_style=True, width=10_000, sort_keys=False).splitlines()[0]


def _options(part: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return part.get("anyOf", [part])

"""What is wrong with a value, and what is allowed, on one line for people."""

import difflib
from collections.abc import Mapping, Sequence
from typing import Any

import yaml
from pydantic import ValidationError
from pydantic_core import ErrorDetails

from egosplat.errors import UserError
from egosplat.pipeline.options import LARGEST_INTEGER, Options, full_names, keys_of

# The JSON schema of a key, or of a part of its value.
Schema = Mapping[str, Any]

# Longest value in a message [characters].
_LONGEST = 80

# Names of JSON schema types, and of what limits a value.
_KINDS = {
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
    "string": "a text",
    "array": "a list, as in [a, b]",
    "object": "keys with values",
    "null": "null",
}
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
    """Make options, which checks the values and adds the defaults (UserError: names ``where`` and the first wrong key).

    ``own`` is the section of the keys that are in no shared one; empty for none.
    """
    try:
        return options.model_validate(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        told = refusal(first, first["loc"], values, keys_of(options), full_names(options, own))
        raise UserError(f"{where}: {told}") from None


def refusal(
    error: ErrorDetails,
    steps: Sequence[int | str],
    given: Mapping[Any, Any],
    keys: Mapping[str, Schema],
    names: Mapping[str, str],
) -> str:
    """Describe an error in one line: the key, its value, and what is allowed.

    ``steps`` name the key, then parts of its value; ``given`` are values, ``keys`` JSON schemas, ``names`` full names by name.
    """
    name = str(steps[0])
    if name not in keys:
        return unknown_key(names.get(name, name), name, list(keys))
    path, value = [names[name]], given[name]
    for step in steps[1:]:  # pydantic adds names of types to the path, too
        items: Any = dict(enumerate(value)) if isinstance(value, list | tuple) else value
        if isinstance(items, Mapping) and step in items:
            path, value = [*path, str(step)], items[step]
    cause = error.get("ctx", {}).get("error")
    why = str(cause or error["msg"]) if cause or len(path) > 1 else _allowed(keys[name], value)
    return not_allowed(".".join(path), value, why)


def not_allowed(key: str, value: object, why: str) -> str:
    """Say that a value is not allowed, and why."""
    key = key if key.isprintable() and len(key) <= _LONGEST else shorten(key)
    return f"{key or 'value'} = {shorten(value)} is not allowed: {why}"


def unknown_key(full: str, key: str, known: Sequence[str], homes: Sequence[str] = ()) -> str:
    """Say that there is no key, ``full`` with its section, among ``known``; ``homes`` are full names of keys of its name."""
    name, colon, value = key.partition(":")
    first, dot, rest = key.partition(".")
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


def _allowed(key: Schema, value: object) -> str:
    """Say what a key allows in place of a refused value."""
    near = difflib.get_close_matches(str(value), choices(key), n=1)
    is_large = isinstance(value, int) and abs(value) > LARGEST_INTEGER
    limit = f", at most {LARGEST_INTEGER}" if is_large else ""
    return f"must be {describe_value(key)}{limit}" + (f" (did you mean {near[0]!r}?)" if near else "")


def describe_value(key: Schema) -> str:
    """Describe the values that the JSON schema of a key allows."""
    words, kinds, limits = choices(key), kinds_of(key), limits_of(key)
    return ", ".join([" or ".join([*kinds, *words]), *limits]) if kinds else f"one of {', '.join(words)}"


def choices(key: Schema) -> list[str]:
    """List the words among the allowed values."""
    return [word for kind in key.get("anyOf", [key]) for word in _words(kind)]


def _words(kind: Schema) -> list[str]:
    return kind.get("enum", [kind["const"]] if "const" in kind else [])


def kinds_of(key: Schema) -> list[str]:
    """List the allowed types, in words."""
    return [_KINDS[kind["type"]] for kind in key.get("anyOf", [key]) if not _words(kind)]


def limits_of(key: Schema) -> list[str]:
    """List the limits of numbers, texts and lists, in words."""
    limits = [(word, kind[word]) for kind in key.get("anyOf", [key]) for word in _LIMITS if word in kind]
    return [_LIMITS[word].format(limit) for word, limit in limits if limit != LARGEST_INTEGER]


def shorten(value: object) -> str:
    """Format a value on one line, cut to ``_LONGEST`` characters."""
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def shown(value: Any) -> str:
    """Format a value as YAML on one line."""
    return yaml.safe_dump(value, default_flow_style=True, width=10_000, sort_keys=False).splitlines()[0]

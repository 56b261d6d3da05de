"""What is wrong with a value, and what is allowed, on one line for people."""

import difflib
import math
import unicodedata
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

_NO_GAIN = "no gain over draft was shown in five times its time: take draft or balanced (docs/speed.md)"

# Removed keys, and values of keys, with their replacement.
_REMOVED = {
    "budget": "set preset (docs/speed.md)",
    "preset: fast": _NO_GAIN,
    "transient.strategy": "3DGS's density control is the only strategy",
    "splats.strategy": "3DGS's density control is the only strategy (benchmarks/training/README.md)",
    "splats.patience": "training always runs to its end: stopping early bought nothing",
    "splats.min_improvement": "training always runs to its end",
    "survey.max_moving_share": "survey.min_moving_share decides now",
    "survey.max_moving_probability": "survey.min_moving_share decides now: a share of the picture",
    "segments.levels": "all three levels are used",
    **dict.fromkeys(
        (
            *("poses.overlap", "poses.max_gap_ms", "poses.seed", "segments.max_covered_new"),
            *(
                "segments.min_uncovered_fraction",
                "instances.drop_iou",
                "instances.claimed",
                "instances.cut_iou",
            ),
            *("splats.position_lr", "splats.grow_grad2d", "splats.antialiased", "language.scales"),
            *("language.channels", "metrics.confidence", "metrics.resamples", "metrics.seed"),
            *("transient.checkpoint_s", "splats.checkpoint_s", "language.checkpoint_s"),
        ),
        "it is a constant now, because nobody changed it",
    ),
    **dict.fromkeys(
        (
            *(
                "segments.pred_iou_thresh",
                "segments.stability_score_thresh",
                "segments.stability_score_offset",
            ),
            *("segments.box_nms_thresh", "segments.nms_iou_thresh", "segments.nms_score_thresh"),
            "segments.nms_inner_thresh",
        ),
        "it follows models.set now (docs/models.md)",
    ),
    **dict.fromkeys(("segments.batch", "view_features.batch", "tiles.batch"), "its size is fixed now"),
}

# New names of renamed keys, by section and old name. Kept for one release.
_RENAMED = {
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
    "models.device": "run.device",
    "models.precision": "run.precision",
    **dict.fromkeys(("instances.seed", "features.seed", "transient.seed", "splats.seed"), "run.seed"),
    "language.seed": "run.seed",
    **dict.fromkeys(("transient.backend", "splats.backend", "language.backend"), "run.backend"),
    "query.backend": "run.backend",
    **dict.fromkeys(("transient.near_plane", "splats.near_plane"), "run.near_plane"),
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
        raise UserError(f"{where}: {_refusal(error, values, options, own)}") from None


def _refusal(error: ValidationError, given: Mapping[Any, Any], options: type[Options], own: str) -> str:
    """Describe the first error of options in one line: the key, its value, and what is allowed."""
    first, keys = error.errors(include_url=False)[0], keys_of(options)
    name, *rest = first["loc"]
    if name not in keys:
        return unknown_key("", name, list(keys))
    path, part, value = [full_names(options, own)[name]], keys[name], given[name]
    names: Mapping[str, Any] = {}
    for step in rest:
        if step == "[key]":  # the key itself is wrong
            part, value = names or {"type": "string"}, path.pop()
            break
        if (inner := _inside(part, value, step)) is None:
            break
        names = _option(part, "object").get("propertyNames", {})
        path, (part, value) = [*path, step], inner
    cause, reason = first.get("ctx", {}).get("error"), why_removed(f"{path[0]}: {value}")
    why = f"it was removed; {reason}" if reason else str(cause) if cause else allowed(part, value)
    return not_allowed(".".join(map(str, path)), value, why)


def why_removed(what: str) -> str | None:
    """Say why a key, or a value as in ``preset: fast``, was removed, and what to set; None for all others."""
    return _REMOVED.get(what)


def not_allowed(key: str, value: object, why: str) -> str:
    """Say that a value is not allowed, and why."""
    key = key if key.isprintable() and len(key) <= _LONGEST else shorten(key)
    return f"{key or 'value'} = {shorten(value)} is not allowed: {why}"


def unknown_key(section: str, key: object, known: Sequence[str], homes: Sequence[str] = ()) -> str:
    """Say that there is no such key, with what is meant: the closest key, a new name, or the reason of its removal.

    Args:
        known: the keys of the section, which is empty outside sections.
        homes: full names of the keys of this name in sections.
    """
    text = str(key)
    name, colon, value = text.partition(":")
    full = f"{section}.{text}" if section else text
    last = section.rpartition(".")[2]
    if advice := why_removed(f"{last}.{text}" if section else text):
        return f"key '{full}' was removed; {advice}"
    if new := _RENAMED.get(f"{last}.{text}"):
        return f"key '{full}' was renamed; write {new!r}"
    first, dot, rest = text.partition(".")
    odd = next((letter for letter in text if not letter.isascii()), None)
    if odd:
        advice = f"{odd!a} ({unicodedata.name(odd, 'no letter')}) is no character of a key; type it anew"
    elif colon and name in known:
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
    words, kinds = choices(part), kinds_of(part)
    if words and not kinds:
        near = difflib.get_close_matches(str(value), words, n=1)
        return describe_value(part) + (f" (did you mean {near[0]!r}?)" if near else "")
    return ", ".join([f"must be {describe_value(part)}", *_hint(kinds, value)])


def describe_value(part: Mapping[str, Any]) -> str:
    """Describe the values that a JSON schema of one key allows."""
    words, kinds = choices(part), kinds_of(part)
    if words and not kinds:
        return f"one of {', '.join(words)}"
    return ", ".join([" or ".join([*kinds, *words]), *limits_of(part)])


def choices(part: Mapping[str, Any]) -> list[str]:
    """List the words among the allowed values."""
    return [str(word) for one in _options(part) for word in one.get("enum", [one[_C]] if _C in one else [])]


def kinds_of(part: Mapping[str, Any]) -> list[str]:
    """List the allowed types, in words."""
    types = [_type(one) for one in _options(part) if not {"enum", _C} & one.keys()]
    return [_KINDS[kind] for one in types for kind in ([one] if isinstance(one, str) else one or [])]


def _type(part: Mapping[str, Any]) -> Any:
    """Get the type in a JSON schema; a reference leads to the schema of an object."""
    return "object" if "$ref" in part else part.get("type")


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


_C = "const"


def _options(part: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return part.get("anyOf", [part])


def _option(part: Mapping[str, Any], kind: str) -> Mapping[str, Any]:
    return next((one for one in _options(part) if one.get("type") == kind), {})


def _inside(part: Mapping[str, Any], value: Any, step: Any) -> tuple[Mapping[str, Any], Any] | None:
    """Get schema and value of an item of a list or mapping; None for the name of a type, which pydantic adds to a path."""
    if isinstance(value, list | tuple) and isinstance(step, int) and step < len(value):
        return _option(part, "array").get("items", {}), value[step]
    if isinstance(value, Mapping) and step in value:
        inner = _option(part, "object").get("additionalProperties", {})
        return inner if isinstance(inner, Mapping) else {}, value[step]
    return None


def _hint(kinds: list[str], value: object) -> list[str]:
    """Help with a number that is almost right."""
    if isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        return [f"at most {LARGEST_INTEGER}"]
    if not isinstance(value, float) or not {"a number", "a whole number"} & {*kinds}:
        return []
    if not math.isfinite(value):
        return ["and finite"]
    return (
        [f"written {value:.0f}"]
        if value.is_integer() and abs(value) < 1e9 and "a number" not in kinds
        else []
    )

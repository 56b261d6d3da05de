"""What is wrong with a configuration, in words."""

import difflib

from egosplat.schema_files import ValidationError
from egosplat.strictness import LARGEST_INTEGER

_LONGEST = 80
"""Of a value in a message [letters]."""


def explained(error: ValidationError) -> str:
    """Which key is wrong, its value, and what is allowed, in one line."""
    key = ".".join(str(part) for part in error.absolute_path)
    key = key if key.isprintable() and len(key) <= _LONGEST else shortened(key)
    if error.validator == "additionalProperties":
        known = list(error.schema["properties"])
        unknown = min(set(error.instance) - set(known), key=str)
        near = difflib.get_close_matches(str(unknown), known, n=1)
        advice = f"did you mean {near[0]!r}?" if near else f"known keys: {', '.join(known)}"
        return f"unknown key {shortened(f'{key}.{unknown}' if key else unknown)}; {advice}"
    return f"{key or 'value'} = {shortened(error.instance)} is not allowed: {_allowed(error)}"


def shortened(value: object) -> str:
    """A value as Python writes it, on one line and not for ever."""
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _allowed(error: ValidationError) -> str:
    limit = error.validator_value
    match error.validator:
        case "enum":
            near = difflib.get_close_matches(str(error.instance), map(str, limit), n=1)
            return f"one of {', '.join(map(str, limit))}" + (f" (did you mean {near[0]!r}?)" if near else "")
        case "type" if isinstance(error.instance, int) and abs(error.instance) > LARGEST_INTEGER:
            return f"at most {LARGEST_INTEGER}"
        case "type":
            return "must be " + " or ".join([limit] if isinstance(limit, str) else limit)
        case "minimum":
            return f"at least {limit}"
        case "maximum":
            return f"at most {limit}"
        case "exclusiveMinimum":
            return f"more than {limit}"
        case "exclusiveMaximum":
            return f"less than {limit}"
        case "minItems":
            return f"at least {limit} of them"
        case "pattern":
            return f"no other word than {limit.strip('^$')}"
        case "minLength":
            return "must not be empty"
        case _:
            return error.message if len(error.message) <= 2 * _LONGEST else f"see {error.validator}"

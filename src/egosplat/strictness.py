"""JSON schema for what people write: stricter than JSON's own rules where YAML and Python are laxer."""

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from egosplat.schema_files import Draft202012Validator, TypeChecker, ValidationError, extend

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

"""The base of all options: configuration keys as fields with type, limits, default and description.

The options of a stage are one class, in ``options.py`` of the stage's room. A key is defined there and nowhere else.
"""

import ast
import contextlib
import functools
import inspect
import itertools
from collections.abc import Callable, Iterable, Iterator
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetPydanticSchema,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    field_validator,
)
from pydantic_core import core_schema

from egosplat.pipeline.strict_yaml import load_yaml

# Largest integer that a key may have. Libraries accept no larger seeds.
LARGEST_INTEGER = 2**31 - 1

# Types that many keys have.
Auto = Literal["auto"]
Count = Annotated[int, Field(ge=1, le=LARGEST_INTEGER)]
Natural = Annotated[int, Field(ge=0, le=LARGEST_INTEGER)]
Positive = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Text = Annotated[str, Field(min_length=1)]

# Marks a key whose values are readings of the paper, or of the methods it compares with: few people change it.
READING = Field(json_schema_extra={"reading": True})


def check_with(passes: Callable[[Any], object], needed: str) -> AfterValidator:
    """Make a check of a value; ``needed`` says in a message what passes it."""

    def check(value: Any) -> Any:
        if not passes(value):
            raise ValueError(needed)
        return value

    return AfterValidator(check)


def one_of(values: Iterable[str]) -> GetPydanticSchema:
    """Mark a text that is one of ``values``, as ``Literal`` does of values that stand in the code."""
    schema = core_schema.literal_schema([*values])
    return GetPydanticSchema(lambda *_: schema)


UNIQUE = check_with(lambda items: len({*items}) == len(items), "no repeated items")


class Options(BaseModel):
    """Keys with values. Unknown keys, NaN, infinity, and values of another type are refused.

    A class says ``section=`` if its keys are in another section of the configuration than the stage's own. Stages share the keys
    of a section by deriving from its class.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True)

    _section: ClassVar[str | None] = None

    def __init_subclass__(cls, section: str | None = None, **rest: Any) -> None:
        super().__init_subclass__(**rest)
        cls._section = section

    @field_validator("*", mode="wrap")
    @classmethod
    def _read(cls, given: Any, check: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        errors = []
        is_word = "'on'" in str(cls.model_fields[info.field_name or ""].annotation)
        for reading in _readings(given, is_word):
            try:
                return check(reading)
            except ValidationError as error:
                errors.append(error)
        raise errors[0]

    def as_dict(self) -> dict[str, Any]:
        """Get the values by name, with lists for tuples."""
        return self.model_dump(mode="json")

    def change(self, **values: Any) -> Self:
        """Make a copy with other values, which are checked."""
        return type(self).model_validate(dict(self) | values)


def _readings(given: Any, is_word: bool) -> Iterator[Any]:
    """What a value may stand for: YAML reads the word on as true, which ``is_word``, Snakemake passes the 5 of ``--config`` as a text."""
    if given == "null":
        yield None
    yield tuple(given) if isinstance(given, list) else given
    if isinstance(given, bool) and is_word:
        yield "on" if given else "off"
    if isinstance(given, str):
        with contextlib.suppress(ValueError):
            if not isinstance(value := load_yaml(given), str | None):
                yield from _readings(value, is_word)


@functools.cache
def keys_of(options: type[Options]) -> dict[str, dict[str, Any]]:
    """Get the JSON schema of each key, by name, described by the string below its field."""
    told: dict[str, str] = {}
    for owner in options.__mro__[options.__mro__.index(Options) - 1 :: -1]:
        (tree,) = ast.parse(inspect.getsource(owner)).body
        assert isinstance(tree, ast.ClassDef)
        for field, text in itertools.pairwise(tree.body):
            if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
                told[ast.unparse(field.target)] = " ".join(ast.literal_eval(text.value).split())
    schemas = options.model_json_schema()["properties"]
    return {name: schema | {"description": told.get(name, "")} for name, schema in schemas.items()}


@functools.cache
def sections_of(options: type[Options], own: str) -> dict[str, tuple[str, ...]]:
    """Get the names of the keys by section of the configuration. Keys of a class without one are in ``own``."""
    names: dict[str, tuple[str, ...]] = {}
    for name in options.model_fields:
        owner: Any = next(c for c in reversed(options.__mro__) if name in inspect.get_annotations(c))
        section = owner._section or own
        names[section] = (*names.get(section, ()), name)
    return names


def full_names(options: type[Options], own: str) -> dict[str, str]:
    """Get ``splats.iterations`` by ``iterations`` of each key; arguments as ``sections_of``."""
    sections = sections_of(options, own).items()
    return {name: f"{section}.{name}" if section else name for section, names in sections for name in names}

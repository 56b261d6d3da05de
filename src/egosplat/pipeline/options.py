"""The base of all options: configuration keys as fields with type, limits, default and description.

The options of a stage are one class, in ``options.py`` of the stage's room. A key is defined there and nowhere else.
"""

import ast
import functools
import inspect
import textwrap
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from egosplat.pipeline.strict_yaml import NO_YAML, load_yaml

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

    @model_validator(mode="before")
    @classmethod
    def _read(cls, given: Any) -> Any:
        """Convert what YAML, Snakemake and the command line write for a value."""
        if not isinstance(given, Mapping):
            return given
        return {
            name: convert(value, keys_of(cls)[name]) if name in cls.model_fields else value
            for name, value in given.items()
        }

    def as_dict(self) -> dict[str, Any]:
        """Get the values by name, with lists for tuples."""
        return self.model_dump(mode="json")

    def change(self, **values: Any) -> Self:
        """Make a copy with other values, which are checked."""
        return type(self).model_validate(dict(self) | values)


@functools.cache
def keys_of(options: type[Options]) -> dict[str, dict[str, Any]]:
    """Get the JSON schema of each key, by name."""
    return options.model_json_schema()["properties"]


@functools.cache
def sections_of(options: type[Options], own: str) -> dict[str, tuple[str, ...]]:
    """Get the names of the keys by section of the configuration. Keys of a class without one are in ``own``."""
    found: dict[str, tuple[str, ...]] = {}
    for name in options.model_fields:
        owner = next(one for one in reversed(options.__mro__) if name in inspect.get_annotations(one))
        section = owner._section or own
        found[section] = (*found.get(section, ()), name)
    return found


def full_names(options: type[Options], own: str) -> dict[str, str]:
    """Get ``splats.iterations`` by ``iterations`` of each key; arguments as ``sections_of``."""
    sections = sections_of(options, own).items()
    return {name: f"{section}.{name}" if section else name for section, names in sections for name in names}


def describe(options: type[Options], name: str) -> str:
    """Get the description of a key, on one line."""
    classes = [one for one in options.__mro__ if name in inspect.get_annotations(one)]
    return _descriptions(classes[0])[name]


@functools.cache
def _descriptions(options: type) -> dict[str, str]:
    """Read the string below each field of a class."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(options))).body
    assert isinstance(tree, ast.ClassDef)
    return {
        ast.unparse(field.target): " ".join(ast.literal_eval(text.value).split())
        for field, text in zip(tree.body, tree.body[1:], strict=False)
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr)
    }


def convert(value: Any, part: Mapping[str, Any]) -> Any:
    """Convert a value to the type in its JSON schema, as far as that is certain; validation refuses the rest."""
    kinds = part.get("anyOf", [part])
    if isinstance(value, str):
        return _from_text(value, kinds)
    # YAML reads the words on and off as booleans.
    if isinstance(value, bool) and any("on" in one.get("enum", ()) for one in kinds):
        return "on" if value else "off"
    for one in kinds:
        if isinstance(value, list) and one.get("type") == "array":
            return tuple(convert(item, one.get("items", {})) for item in value)
        if isinstance(value, Mapping) and isinstance(other := one.get("additionalProperties"), Mapping):
            return {key: convert(item, other) for key, item in value.items()}
    return value


def _from_text(text: str, kinds: list[Mapping[str, Any]]) -> Any:
    # Snakemake passes the 5 of `--config splats={iterations: 5}` and the 1e-4 of a file as strings.
    types = [one.get("type") for one in kinds]
    if text == "null" and "null" in types:
        return None
    # A key that may be any text keeps it: a file named 5 is not a number.
    words = [word for one in kinds for word in one.get("enum", [one.get("const")])]
    if text in words or any(
        one.get("type") == "string" and not {"enum", "const"} & one.keys() for one in kinds
    ):
        return text
    try:
        value = load_yaml(text)
    except NO_YAML:
        return text
    # A list or mapping may hold texts that are numbers in turn.
    return text if isinstance(value, str) else convert(value, {"anyOf": kinds})

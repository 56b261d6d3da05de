"""Flags of commands: one for each key of the configuration, and for each path of a stage."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from egosplat.pipeline.config import schema, section_keys, stage_keys
from egosplat.pipeline.stages import FILES, STAGES, path_help
from egosplat.pipeline.strict_yaml import NO_YAML, load_yaml
from egosplat.pipeline.validation import LARGEST_INTEGER

ARTIFACT = click.Path(path_type=Path)

OVERWRITE: dict[str, Any] = {"is_flag": True, "help": "Replace the file of --output if it is there."}

# Flags that come from the table of scenes.
SCENE = {
    "title": click.Option(["--title"], default="scene", show_default=True, help="Title of the scene."),
    "method": click.Option(
        ["--method"], help="Published method that the codes stand for. [default: EgoSplat]"
    ),
    "format": click.Option(
        ["--format"],
        type=click.Choice(schema("scenes")["properties"]["format"]["enum"]),
        required=True,
        help="How the recording is laid out on disk.",
    ),
}


class TextList(click.ParamType):
    """A YAML list of at least ``least`` texts: ``[object, "some thing"]``."""

    name = "list"

    def __init__(self, least: int) -> None:
        self.least = least

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> tuple[str, ...]:
        """Parse the list. A value that is already a list is returned as it is."""
        try:
            texts = load_yaml(value) if isinstance(value, str) else value
        except NO_YAML:
            texts = None
        if not isinstance(texts, list | tuple) or not all(isinstance(text, str) for text in texts):
            self.fail(f"{value!r} is not a list of texts, as in [object, things]", parameter, context)
        if len(texts) < self.least:
            self.fail(f"needs at least {self.least} text", parameter, context)
        return tuple(texts)


class Json(click.ParamType):
    """A JSON value."""

    name = "json"

    def convert(self, value: Any, parameter: click.Parameter | None, context: click.Context | None) -> Any:
        """Parse the value."""
        try:
            return json.loads(value)
        except (ValueError, RecursionError) as error:
            self.fail(f"is not JSON ({error})", parameter, context)


JSON = Json()


class OrWord(click.ParamType):
    """A number or one word."""

    def __init__(self, number: click.ParamType, word: str) -> None:
        self.number, self.word, self.name = number, word, f"{number.name} or {word}"

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> int | float | str:
        """Return the word as it is, or parse the number."""
        return value if value == self.word else self.number.convert(value, parameter, context)


def stage_flags(stage: str) -> list[click.Parameter]:
    """The flags of a stage: its paths, what the table of scenes says, and its keys."""
    about = STAGES[stage]
    paths = [
        click.Option(
            [f"--{name.replace('_', '-')}", name],
            type=ARTIFACT,
            required=name not in about.optional,
            help=text[0].upper() + text[1:] + ".",
        )
        for name, text in path_help(about).items()
    ]
    keys = (flag(name, key) for name, key in stage_keys(stage).items())
    overwrite = [click.Option(["--overwrite"], **OVERWRITE)] if stage in FILES else []
    return [*paths, *overwrite, *(SCENE[name] for name in about.scene), *keys]


def flag(name: str, key: dict[str, Any]) -> click.Option:
    """The flag of a configuration key, from the key's schema."""
    text = "--" + name.replace("_", "-")
    common: dict[str, Any] = {"default": key["default"], "show_default": True, "help": key["description"]}
    if "enum" in key:
        return click.Option([text, name], type=click.Choice(key["enum"]), **common)
    kind = key["type"] if isinstance(key["type"], str) else key["type"][0]
    if kind == "boolean":
        return click.Option([f"{text}/--no-{text[2:]}"], **common)
    if kind == "array":
        return click.Option([text, name], type=TextList(key.get("minItems", 0)), **common)
    if kind == "string":
        return click.Option([text, name], **common)
    number = _range(kind, key)
    word = key.get("pattern", "").strip("^$")
    return click.Option([text, name], type=OrWord(number, word) if word else number, **common)


class Finite(click.FloatRange):
    """A finite number in a range. Rejects infinity, and NaN, which passes every bound."""

    def convert(self, value: Any, parameter: click.Parameter | None, context: click.Context | None) -> float:
        """Parse the number."""
        number = super().convert(value, parameter, context)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number", parameter, context)
        return number


def _range(kind: str, key: dict[str, Any]) -> click.ParamType:
    make: Callable[..., click.ParamType] = {"integer": click.IntRange, "number": Finite}[kind]
    lower = key.get("exclusiveMinimum", key.get("minimum"))
    upper = key.get("exclusiveMaximum", key.get("maximum", LARGEST_INTEGER if kind == "integer" else None))
    return make(min=lower, max=upper, min_open="exclusiveMinimum" in key, max_open="exclusiveMaximum" in key)


def query_flags() -> list[click.Option]:
    """The flags of a command that answers queries."""
    models = {name: section_keys("models")[name] for name in ("device", "precision")}
    return [flag(name, key) for name, key in {**section_keys("query"), **models}.items()]

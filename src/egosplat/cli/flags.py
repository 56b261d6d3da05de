"""Flags of commands: paths of stages, and ``--options`` and ``--set`` with the keys that they take, listed by ``--help``."""

import gc
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from egosplat.errors import UserError
from egosplat.pipeline.config import parse_value
from egosplat.pipeline.messages import describe_value, make_options, shorten, shown
from egosplat.pipeline.options import Options, full_names, keys_of, sections_of
from egosplat.pipeline.stages import FILES, STAGES, path_help
from egosplat.pipeline.variants import PRESET_FILES
from egosplat.progress import hush_log

ARTIFACT = click.Path(path_type=Path)

OVERWRITE: dict[str, Any] = {"is_flag": True, "help": "Replace the file of --output if it is there."}

# Hides all but results and errors.
QUIET: dict[str, Any] = {"is_flag": True, "expose_value": False, "help": "Print results and errors alone."}
QUIET["callback"] = lambda context, parameter, value: hush_log() if value else None

# Types of the flags that come from the table of scenes; those that are not here are texts.
SCENE = {
    "preset": click.Choice(sorted({*PRESET_FILES, *PRESET_FILES.values()})),
    "world_seed": click.IntRange(0),
    "format": click.Choice(list(STAGES["frames"].modules)),
}

# Flags of a stage whose frames jobs can share.
CHUNKS: dict[str, dict[str, Any]] = {
    "chunk": {"type": click.IntRange(1), "help": "Number of the chunk of frames, or cell, to work on."},
    "gather": {"type": ARTIFACT, "multiple": True, "help": "Results of all chunks, in order."},
}


@contextmanager
def without_collection() -> Iterator[None]:
    """Search for no garbage inside this context, and never again among what is left of it: while torch is imported, its half a
    million objects are searched tens of times."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def parse_time(context: click.Context, parameter: click.Parameter, value: str | None) -> float | None:
    """Convert a time of a recording, "1:05" or "65", to 65.0 [s]."""
    if value is None:
        return None
    if (parts := re.fullmatch(r"(?:(\d{1,9}):)?(\d{1,9}(?:\.\d*)?)", value, re.ASCII)) is None:
        told = f"{value[:40]!r} is no time; give seconds, as 65, or minutes and seconds, as 1:05"
        raise click.BadParameter(told)
    return 60.0 * int(parts[1] or 0) + float(parts[2])


class KeysCommand(click.Command):
    """A command whose callback gets ``options`` of a class, with a section ``own`` beside shared ones; ``--help`` lists their
    keys, but if it is ``brief``."""

    def __init__(
        self,
        name: str,
        options: type[Options],
        own: str,
        params: Sequence[click.Parameter],
        brief: bool = False,
        **rest: Any,
    ) -> None:
        self.options, self.own, self.brief = options, own, brief
        about = "Value of a key of the page that egosplat keys prints. May be repeated."
        flags = [
            click.Option(
                ["--options", "given"], metavar="JSON", default="{}", hidden=brief, help="Values of keys."
            ),
            click.Option(["--set", "pairs"], multiple=True, metavar="KEY=VALUE", help=about),
        ]
        super().__init__(name, params=[*params, *flags], **rest)

    def invoke(self, context: click.Context) -> Any:
        """Call the callback with checked options."""
        given, pairs = context.params.pop("given"), context.params.pop("pairs")
        try:
            values = json.loads(given)
        except (ValueError, RecursionError) as error:
            raise click.BadParameter(f"is not JSON ({error})", context, param_hint="--options") from None
        context.params["options"] = read_options(self.options, self.own, values, pairs)
        return super().invoke(context)

    def format_options(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the flags, then the keys but for readings of the paper."""
        super().format_options(context, formatter)
        keys, sections = keys_of(self.options), dict(sections_of(self.options, self.own))
        names = [*sections.pop(self.own, ()), *(name for shared in sections.values() for name in shared)]
        rows = [(name, self._about(name)) for name in names if not keys[name].get("reading")]
        if rows and not self.brief:
            with formatter.section("Keys"):
                formatter.write_dl(rows, col_max=28)

    def _about(self, name: str) -> str:
        """Describe a key: its first sentence, its default, and what is allowed."""
        key = keys_of(self.options)[name]
        sentence = key["description"].split(". ")[0].rstrip(".")
        return f"{sentence}. [default: {shown(key['default'])}; {describe_value(key)}]"


def read_options(options: type[Options], own: str, given: Any, pairs: Iterable[str]) -> Options:
    """Make options from values and from words such as ``iterations=500`` or ``run.seed=1``, which win (UserError)."""
    if not isinstance(given, dict):
        raise UserError(f"--options: {shorten(given)} is no JSON object")
    short = {full: name for name, full in full_names(options, own).items()}
    values = dict(given)
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not (equals and key):
            raise UserError(f"--set: {shorten(pair)} is not of the form key=value, as in iterations=500")
        values[short.get(key, key)] = parse_value(value, f"--set {shorten(pair)}")
    return make_options(options, values, "--set" if pairs else "--options", own)


def path_flags(stage: str) -> list[click.Parameter]:
    """Make the flags of a stage: its paths, and what the table of scenes says."""
    about = STAGES[stage]
    flags: dict[str, dict[str, Any]] = {}
    for name, text in path_help(about).items():
        told = f"{text[0].upper()}{text[1:]}."
        flags[name] = {"type": ARTIFACT, "required": name not in about.optional, "help": told}
    flags |= {"overwrite": OVERWRITE} if stage in FILES else {}
    flags |= CHUNKS if about.by_chunks else {}
    for name in about.scene:
        value = {"type": SCENE.get(name), "default": "scene" if name == "title" else None}
        flags[name] = value | {"required": name == "format", "help": f"{name} of the scene's row."}
    return [click.Option([f"--{name.replace('_', '-')}", name], **flag) for name, flag in flags.items()]

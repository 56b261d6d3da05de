"""Options on the command line: ``--options`` and ``--set``, and the keys that they take, listed by ``--help``."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, get_args

import click

from egosplat.errors import UserError
from egosplat.pipeline.config import parse_value
from egosplat.pipeline.general_options import Format
from egosplat.pipeline.messages import describe_value, make_options, shorten, shown
from egosplat.pipeline.options import Options, describe, full_names, keys_of, sections_of
from egosplat.pipeline.stages import FILES, STAGES, path_help
from egosplat.pipeline.variants import PRESET_FILES

ARTIFACT = click.Path(path_type=Path)

OVERWRITE: dict[str, Any] = {"is_flag": True, "help": "Replace the file of --output if it is there."}

PRESETS = sorted({*PRESET_FILES, *PRESET_FILES.values()})

# Flags that come from the table of scenes.
SCENE = {
    "title": click.Option(["--title"], default="scene", show_default=True, help="Title of the scene."),
    "method": click.Option(
        ["--method"], help="Published method that the codes stand for. [default: EgoSplat]"
    ),
    "preset": click.Option(["--preset"], type=click.Choice(PRESETS), help="Preset of the scene."),
    "world_seed": click.Option(["--world-seed"], type=click.IntRange(0), help="synthetic.seed of the scene."),
    "camera": click.Option(
        ["--camera"], type=click.Choice(["ideal", "real"]), help="synthetic.camera of the scene."
    ),
    "format": click.Option(
        ["--format"],
        type=click.Choice(get_args(Format)),
        required=True,
        help="How the recording is laid out on disk.",
    ),
}


# Flags of a stage whose frames jobs can share.
CHUNKS = (
    click.Option(
        ["--chunk"],
        type=click.IntRange(1),
        help="Number of the chunk of frames to work on alone; the output is a file with its results.",
    ),
    click.Option(
        ["--gather"],
        type=ARTIFACT,
        multiple=True,
        help="Results of a chunk. Repeated for all chunks, in order, they take the place of the work.",
    ),
)


def parse_time(context: click.Context, parameter: click.Parameter, value: str | None) -> float | None:
    """Convert a time of a recording, "1:05" or "65", to 65.0 [s]."""
    if value is None:
        return None
    minutes, _, seconds = value.rpartition(":")
    try:
        parts = float(int(minutes or 0)), float(seconds)
    except (ValueError, OverflowError):
        parts = -1.0, 0.0
    time = 60 * parts[0] + parts[1]
    if min(parts) < 0 or not time < float("inf"):
        told = f"{value[:40]!r} is no time; give seconds, as 65, or minutes and seconds, as 1:05"
        raise click.BadParameter(told)
    return time


def _parse_json(context: click.Context, parameter: click.Parameter, value: str) -> Any:
    try:
        return json.loads(value)
    except (ValueError, RecursionError) as error:
        raise click.BadParameter(f"is not JSON ({error})") from None


class KeysCommand(click.Command):
    """A command with options, whose keys ``--help`` lists. The callback gets them as ``options``.

    Attributes:
        options: their class.
        own: section of the keys that are in no shared one.
        plain: keys with a flag of their own. With such, only ``--help-all`` lists the keys.
    """

    def __init__(
        self,
        name: str,
        options: type[Options],
        own: str,
        params: Sequence[click.Parameter],
        plain: Sequence[str] = (),
        **rest: Any,
    ) -> None:
        self.options, self.own, self.plain = options, own, plain
        given = {"callback": _parse_json, "metavar": "JSON", "default": "{}", "hidden": bool(plain)}
        text = f"Value of a key{', see --help-all' if plain else ''}. May be repeated."
        every = "Show all keys with their whole descriptions."
        shows = {"is_flag": True, "is_eager": True, "expose_value": False, "callback": _show_all}
        flags = [
            *map(self._plain_flag, plain),
            click.Option(["--options", "given"], help="Values of keys as JSON.", **given),
            click.Option(["--set", "pairs"], multiple=True, metavar="KEY=VALUE", help=text),
            click.Option(["--help-all"], help=every, **shows),
        ]
        super().__init__(name, params=[*params, *flags], **rest)

    def invoke(self, context: click.Context) -> Any:
        """Call the callback with checked options."""
        given, pairs = context.params.pop("given"), context.params.pop("pairs")
        flags = {name: context.params.pop(name) for name in self.plain}
        pairs = [*(f"{name}={value}" for name, value in flags.items() if value is not None), *pairs]
        context.params["options"] = read_options(self.options, self.own, given, pairs)
        return super().invoke(context)

    def _plain_flag(self, name: str) -> click.Option:
        about = _about(describe(self.options, name), keys_of(self.options)[name], whole=False)
        return click.Option([f"--{name.replace('_', '-')}", name], metavar="VALUE", help=about)

    def format_options(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the flags, then the keys."""
        super().format_options(context, formatter)
        keys, every = keys_of(self.options), context.obj == "all"
        if self.plain and not every:
            return
        sections = sections_of(self.options, self.own)
        others = [name for own, names in sections.items() if own != self.own for name in names]
        names = [*sections.get(self.own, ()), *others]
        readings = [name for name in names if keys[name].get("reading")]
        parts = {"Keys": [name for name in names if name not in readings]}
        parts |= {"Readings of the paper": readings} if every else {}
        for title, part in parts.items():
            rows = [(name, _about(describe(self.options, name), keys[name], every)) for name in part]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows, col_max=28)


def _about(text: str, key: dict[str, Any], whole: bool) -> str:
    """Describe a key: what it is, its default, and what is allowed."""
    sentence = text if whole else text.split(". ")[0].rstrip(".") + "."
    return f"{sentence} [default: {shown(key['default'])}; {describe_value(key)}]"


def _show_all(context: click.Context, _: click.Parameter, asked: bool) -> None:
    if asked:
        context.obj = "all"
        click.echo(context.get_help())
        context.exit()


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
    paths = [
        click.Option(
            [f"--{name.replace('_', '-')}", name],
            type=ARTIFACT,
            required=name not in about.optional,
            help=text[0].upper() + text[1:] + ".",
        )
        for name, text in path_help(about).items()
    ]
    overwrite = [click.Option(["--overwrite"], **OVERWRITE)] if stage in FILES else []
    return [*paths, *overwrite, *(CHUNKS if about.by_chunks else ()), *(SCENE[name] for name in about.scene)]

"""The command ``run``: a scene from a recording, in one call."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import click

from egosplat.cli.flags import ARTIFACT
from egosplat.cli.scenes import ask
from egosplat.pipeline.general_options import GeneralOptions
from egosplat.query.options import AskingOptions

# The option that takes all words up to the next option.
_WORDS = "--words"

# Things that most homes have.
_EXAMPLE = "chair table cup"


class RunCommand(click.Command):
    """A command whose option ``--words`` takes several words."""

    def parse_args(self, context: click.Context, args: list[str]) -> list[str]:
        """Parse the command line."""
        return super().parse_args(context, spread(args))


def spread(args: Sequence[str]) -> list[str]:
    """Repeat ``--words`` before each of the words behind it, as click needs it."""
    found, inside = [], False
    for place, word in enumerate(args):
        last = place + 1 == len(args) or args[place + 1].startswith("-")
        if word == _WORDS and not last:
            inside = True
            continue
        inside = inside and not word.startswith("-")
        found += [_WORDS, word] if inside else [word]
    return found


def run_command() -> click.Command:
    """Build the command ``run``."""

    def call(
        source: Path,
        name: str | None,
        preset: str | None,
        pairs: tuple[str, ...],
        splat: str | None,
        cores: int | None,
        words: tuple[str, ...],
        show: bool,
    ) -> None:
        from egosplat.run.command import make_scene

        if any(not word.strip() for word in words):
            raise click.UsageError(f"{_WORDS}: a word is empty")
        if splat is not None:
            if any(map(str.isspace, splat)):
                raise click.UsageError(
                    f"--splat {splat}: has a space in its name; rename it, or give a link to it"
                )
            pairs = (*pairs, f"splats.source={splat}")
        try:
            folder = make_scene(source, name, preset, pairs, cores).results
        except KeyboardInterrupt:
            click.echo("Stopped. Finished steps are kept: the same command goes on from here.", err=True)
            raise SystemExit(130) from None
        if words:
            ask(folder, words, AskingOptions(), folder / "query.png")
        where = shlex.quote(str(folder))
        click.echo(f"{folder} is ready.")
        click.echo(f"  egosplat query {where} {_EXAMPLE}    where is it?")
        click.echo(
            f"  egosplat view {where}    walk through the scene in the browser, ask it, click on things"
        )
        if show:
            from egosplat.viewing.command import run

            run(folder, {}, "127.0.0.1", 0, browse=True)

    presets = click.Choice(get_args(GeneralOptions.model_fields["preset"].annotation))
    preset = "Speed or accuracy, as in draft. [default: balanced]"
    name = "Name of the scene. [default: mine/ and that of SOURCE]"
    pairs = "Key of this scene, as in frames.stride=3. May be repeated."
    splat = "Gaussians that another program trained on SOURCE, .ply or .spz: none are trained."
    show = "Open the scene in the browser at the end."
    return RunCommand(
        "run",
        callback=call,
        params=[
            click.Argument(["source"], type=ARTIFACT),
            click.Option(["--preset"], type=presets, help=preset),
            click.Option([_WORDS], multiple=True, metavar="WORD ...", help="Ask for these at the end."),
            click.Option(["--open", "show"], is_flag=True, help=show),
            click.Option(["--name"], metavar="DATASET/SCENE", help=name),
            click.Option(["--set", "pairs"], multiple=True, metavar="KEY=VALUE", help=pairs),
            click.Option(["--splat"], type=click.Path(exists=True, dir_okay=False), help=splat),
            click.Option(["--cores"], type=click.IntRange(1), help="Number of processors. [default: all]"),
        ],
        help="Make a scene of SOURCE, which can be asked: a video, a folder or .zip of photographs, a folder of COLMAP or "
        "nerfstudio, or a .vrs of Aria glasses. Run again, it does what is new.",
    )

"""Commands on a scene: ``run``, and on the folder of a finished one ``query``, ``page``, ``view``, ``export`` and ``movie``.

Their keys come from the options of stages, so each is built only when it is called.
"""

import shlex
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, get_args

import click

from egosplat.cli.collection import without_collection
from egosplat.cli.flags import ARTIFACT, OVERWRITE, KeysCommand, parse_time
from egosplat.export.formats import FORMATS, check_export
from egosplat.files import check_output
from egosplat.pipeline.general_options import GeneralOptions
from egosplat.pipeline.options import Options
from egosplat.pipeline.scene_folder import ASKED, check_scene_folder
from egosplat.pipeline.stages import STAGES
from egosplat.query.options import MOST, AskingOptions
from egosplat.viewing.options import PageOptions, ScenePageOptions

PHRASES = click.Argument(["phrases"], nargs=-1, required=True)

# The option that takes all words up to the next option.
_WORDS = "--words"

# Things that most homes have.
_EXAMPLE = "chair table cup"


def _make(
    call: Callable[..., None], options: type[Options], own: str, params: Sequence[click.Parameter], about: str
) -> click.Command:
    """Build the command of a function ``call_NAME`` of a folder; its keys are in the section ``own``."""
    params = [click.Argument(["folder"], type=ARTIFACT), *params]
    name = call.__name__.removeprefix("call_")
    # The key with a flag of its own; --help-all lists the others, for --set.
    return KeysCommand(name, options, own, callback=call, params=params, plain=("min_score",), help=about)


def _output(what: str) -> list[click.Option]:
    """Make the flags of what a command writes."""
    return [click.Option(["--output"], type=ARTIFACT, help=what), click.Option(["--overwrite"], **OVERWRITE)]


def _check_paths(
    folder: Path, stages: Iterable[str], name: str, output: Path | None, overwrite: bool
) -> Path:
    """Check the folder of a scene and where its command writes; get the latter."""
    check_scene_folder(folder, stages)
    output = output or folder / name
    check_output(output, name, overwrite=overwrite)
    return output


def ask(
    folder: Path,
    phrases: tuple[str, ...],
    options: AskingOptions,
    output: Path,
    frame: int | None = None,
    pose: Path | None = None,
    most: int = MOST,
    at: float | None = None,
) -> None:
    """Print the answers of a scene, and draw them; arguments as the flags of ``query``."""
    with without_collection():
        from egosplat.query.command import run
        from egosplat.query.finished_scene import open_scene

        scene = open_scene(folder, options)
        for part in run(scene, phrases, scene.viewpoint(frame, pose), most, output, at):
            click.echo(part)


def query_command() -> click.Command:
    """Build the command ``query``, with the keys of the section ``query``."""

    def call_query(
        folder: Path, output: Path | None, overwrite: bool, options: AskingOptions, **asked: Any
    ) -> None:
        output = _check_paths(folder, ASKED, "query.png", output, overwrite)
        ask(folder, options=options, output=output, **asked)

    frame = "Search only this frame. [default: the whole scene]"
    pose = 'Search only this view: JSON file, {"camera_to_world": 4 rows of 4}.'
    most = "Largest number of matches listed for the whole scene."
    at = "Tell where carried things were at this time of the recording, as 1:05 or 65 [s]; with --pose, ask the view at it."
    flags = [
        click.Option(["--at"], callback=parse_time, metavar="MIN:S", help=at),
        click.Option(["--frame"], type=click.IntRange(min=0), help=frame),
        click.Option(["--pose"], type=ARTIFACT, help=pose),
        click.Option(["--most"], type=click.IntRange(min=1), default=MOST, show_default=True, help=most),
        *_output("Output image, .png. [default: FOLDER/query.png]"),
    ]
    about = "Find each of PHRASES in the finished scene of FOLDER, such as results/adt/scene1."
    return _make(call_query, AskingOptions, "query", [PHRASES, *flags], about)


def page_command() -> click.Command:
    """Build the command ``page``, with the keys of the stage ``scene_page``."""
    stage = STAGES["scene_page"]

    def call_page(
        folder: Path, output: Path | None, overwrite: bool, title: str | None, options: ScenePageOptions
    ) -> None:
        target = _check_paths(folder, stage.inputs, stage.output, output, overwrite)
        from egosplat.viewing.command import write_page

        write_page(folder, target, options, title)

    title = click.Option(["--title"], help="Title of the scene. [default: dataset/scene]")
    flags = [*_output("Output page, .html. [default: FOLDER/scene.html]"), title]
    about = "Write the finished scene of FOLDER as one HTML file to share: it answers queries in the browser."
    return _make(call_page, ScenePageOptions, "scene_page", flags, about)


def view_command() -> click.Command:
    """Build the command ``view``, with the keys of the page but those of OpenCLIP, which the scene tells."""

    def call_view(folder: Path, host: str, port: int, options: PageOptions) -> None:
        from egosplat.viewing.command import run

        run(folder, options, host, port)

    host = "Address to listen at. Other computers need the whole address that is printed."
    ports = click.IntRange(0, 65535)
    flags = [
        click.Option(["--host"], default="127.0.0.1", show_default=True, help=host),
        click.Option(["--port"], type=ports, default=8080, show_default=True, help="0: any free port."),
    ]
    about = "Show the finished scene of FOLDER, such as results/adt/scene1, in the browser."
    return _make(call_view, PageOptions, "scene_page", flags, about)


def export_command() -> click.Command:
    """Build the command ``export``, with the keys of the section ``query``."""

    def call_export(
        folder: Path,
        output: Path | None,
        options: AskingOptions,
        format: str | None,
        query: str | None,
        codes: bool,
        overwrite: bool,
    ) -> None:
        format, output = check_export(folder, output, format, query, codes=codes, overwrite=overwrite)
        from egosplat.export.scene import export_folder

        export_folder(folder, output, format, query, codes, options)

    form = (
        "Gaussians (ply, spz), a point cloud in the colors of instances, a table of what is carried (carries), images with "
        "cameras (nerfstudio, colmap), the scene page (html), or all of these over time for Rerun (rrd). [default: by the "
        "suffix of --output, else ply]"
    )
    query = (
        "Only the Gaussians of the best answer; ply and spz. Boxes of answers to words between commas; rrd."
    )
    codes = "Include the language codes; ply."
    flags = [
        click.Option(["--format"], type=click.Choice(list(FORMATS)), help=form),
        click.Option(["--query"], metavar="WORDS", help=query),
        *_output("Output file or folder.  [default: a name in FOLDER]"),
        click.Option(["--codes/--no-codes"], default=True, show_default=True, help=codes),
    ]
    about = "Write the finished scene of FOLDER, such as results/adt/scene1, for other programs."
    return _make(call_export, AskingOptions, "query", flags, about)


def movie_command() -> click.Command:
    """Build the command ``movie``, with the keys of the section ``query``."""

    def call_movie(
        folder: Path, output: Path | None, overwrite: bool, options: AskingOptions, **asked: Any
    ) -> None:
        output = _check_paths(folder, ASKED, "query.webp", output, overwrite)
        from egosplat.export.movie import run
        from egosplat.query.finished_scene import open_scene

        run(open_scene(folder, options), output=output, **asked)

    sides, side = click.IntRange(32, 4096), "Longer side of the picture [px]."
    flags = [
        *_output("Output picture, .webp.  [default: FOLDER/query.webp]"),
        click.Option(["--side"], type=sides, default=480, show_default=True, help=side),
    ]
    about = "Draw a moving picture of FOLDER that is asked for PHRASES: the camera goes to each answer."
    return _make(call_movie, AskingOptions, "query", [PHRASES, *flags], about)


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

            run(folder, PageOptions(), "127.0.0.1", 0, browse=True)

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

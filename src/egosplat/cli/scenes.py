"""Commands on a scene: ``run``, and on the folder of a finished one ``query``, ``calibrate``, ``page``, ``view``, ``export`` and ``movie``."""

import contextlib
import json
import shlex
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import click

from egosplat.cli.flags import ARTIFACT, OVERWRITE, QUIET, KeysCommand, parse_time, without_collection
from egosplat.errors import without_secrets
from egosplat.export.scene import FORMATS, export_scene
from egosplat.files import check_output
from egosplat.pipeline.home import ASKED, PRESET_NAMES, check_scene_folder, make_command
from egosplat.pipeline.options import Options
from egosplat.pipeline.stages import STAGES
from egosplat.progress import log
from egosplat.query.options import MOST, AskingOptions
from egosplat.viewing.options import PageOptions, ScenePageOptions

FILE = click.Path(exists=True, dir_okay=False)


def on_folder(options: type[Options], own: str, about: str) -> Callable[..., KeysCommand]:
    """Make a command of a function of a scene's ``folder`` and ``options``, whose keys are in the section ``own``."""

    def decorate(function: Callable[..., None]) -> KeysCommand:
        made = click.command(cls=KeysCommand, options=options, own=own, brief=True, short_help=about)
        return made(click.argument("folder", type=ARTIFACT)(function))

    return decorate


JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON alone, see docs/look.md#json.")


def writes(what: str) -> Callable[..., Callable[..., None]]:
    """Add the flags of a command that writes something."""

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        overwrite = click.option("--overwrite", **OVERWRITE)(click.option("--quiet", **QUIET)(function))
        return click.option("--output", type=ARTIFACT, help=what)(overwrite)

    return decorate


def _check_paths(
    folder: Path, stages: Iterable[str], name: str, output: Path | None, overwrite: bool
) -> Path:
    """Check the folder of a scene and where its command writes; get the latter."""
    check_scene_folder(folder, stages)
    output = output or folder / name
    check_output(output, name, overwrite=overwrite)
    return output


@on_folder(AskingOptions, "query", "Find things in a finished scene by words, or by a picture.")
@click.argument("phrases", nargs=-1)
@click.option("--like", multiple=True, type=FILE, help="Picture of a thing to find. PHRASES are then scenes.")
@click.option("--names", type=ARTIFACT, help="Scene whose names, given by egosplat name, are known as well.")
@click.option("--at", callback=parse_time, metavar="MIN:S", help="Where carried things were then, as 1:05.")
@click.option("--frame", type=click.IntRange(0), help="Search only this frame. [default: the whole scene]")
@click.option("--pose", type=ARTIFACT, help='Search only this view: JSON, {"camera_to_world": 4 rows of 4}.')
@click.option("--most", type=click.IntRange(1), default=MOST, show_default=True, help="Most matches listed.")
@JSON
@writes("Output image, .png. [default: FOLDER/query.png]")
def query(
    folder: Path,
    phrases: tuple[str, ...],
    options: AskingOptions,
    as_json: bool = False,
    output: Path | None = None,
    overwrite: bool = False,
    frame: int | None = None,
    pose: Path | None = None,
    most: int = MOST,
    at: float | None = None,
    like: tuple[str, ...] = (),
    names: Path | None = None,
) -> None:
    """Find each of PHRASES in the finished scene of FOLDER, such as results/adt/scene1; or what --like shows."""
    if not (phrases or like):
        raise click.UsageError("give words, or a picture: --like crop.png")
    if as_json and output:
        raise click.UsageError("--output: goes without --json, which draws no picture")
    if like and names:
        raise click.UsageError("--names: goes with words, not with --like")
    # With --json nothing is written, and the scene may be one that nobody may write to.
    output = folder if as_json else _check_paths(folder, ASKED, "query.png", output, overwrite)
    with without_collection():
        from egosplat.query import like as pictures
        from egosplat.query.command import describe, list_answers, run
        from egosplat.query.finished_scene import open_scene

        scene = open_scene(folder, options)
        known = pictures.read_names(folder) | (pictures.read_names(names) if names else {})
        asked = () if like else phrases
        named = {one: known[name] for one in asked if (name := pictures.find_name(one, known))}
        if (like or named) and (frame, pose, at) != (None, None, None):
            raise click.UsageError("--frame, --pose and --at: go with words alone, no picture or name")
        rest = [one for one in phrases if one not in named and not like]
        scenes = [scene, *(open_scene(Path(one), options) for one in phrases if like)]
        if as_json:
            wanted = {str(one): pictures.read_picture(one) for one in map(Path, like)}, named, most
            looks = [(one, pictures.ask_looks(one, *wanted)) for one in scenes if like or named]
            alike = [describe(one, answer) for one, found in looks for answer, _ in found]
            view = scene.viewpoint(frame, pose)
            return click.echo(json.dumps([*alike, *list_answers(scene, rest, view, most, at)], indent=1))
        if like or named:
            page = output.with_stem(f"{output.stem}_like") if rest else output
            for paragraph in pictures.run(scenes, [*map(Path, like)], named, most, page):
                click.echo(paragraph)
        if rest:
            for paragraph in run(scene, rest, scene.viewpoint(frame, pose), most, output, at):
                click.echo(paragraph)


@on_folder(AskingOptions, "query", "Give a thing of a finished scene a name, to ask for it.")
@click.argument("thing")
@click.argument("name")
def name(folder: Path, thing: str, name: str, options: AskingOptions) -> None:
    """Give THING of the scene of FOLDER the NAME "my mug". THING: a word that finds it, or its place, as 0.1,2,-1."""
    check_scene_folder(folder, ASKED)
    from egosplat.query.command import show_point
    from egosplat.query.finished_scene import open_scene
    from egosplat.query.like import give_name

    name, scene = " ".join(name.split()), open_scene(folder, options)
    place = f"{show_point(give_name(scene, thing, name).center)} {scene.unit}"
    click.echo(f'The thing at {place} is "{name}": {shlex.join(["egosplat", "query", str(folder), name])}')


# A place may begin with a minus.
name.ignore_unknown_options = True


@on_folder(AskingOptions, "query", "Fit the grades of a finished scene to your own judgements.")
@click.argument("labels", type=FILE)
def calibrate(folder: Path, labels: str, options: AskingOptions) -> None:
    """Fit the grades of FOLDER to LABELS: a .csv with the line phrase,label and lines as cup,right or cup,wrong or cup,absent."""
    check_scene_folder(folder, ASKED)
    from egosplat.query.calibrate import run
    from egosplat.query.finished_scene import open_scene

    for line in run(open_scene(folder, options), Path(labels)):
        click.echo(line)


@on_folder(ScenePageOptions, "scene_page", "Write a finished scene as one HTML file to share.")
@writes("Output page, .html. [default: FOLDER/scene.html]")
@click.option("--title", help="Title of the scene. [default: dataset/scene]")
def page(
    folder: Path, output: Path | None, overwrite: bool, title: str | None, options: ScenePageOptions
) -> None:
    """Write the finished scene of FOLDER as one HTML file to share: it answers queries in the browser."""
    stage = STAGES["scene_page"]
    target = _check_paths(folder, stage.inputs, stage.output, output, overwrite)
    from egosplat.viewing.command import write_page

    write_page(folder, target, options, title)


@on_folder(AskingOptions, "query", "List what is in a finished scene.")
@JSON
@writes("Output table, .csv or .json, or folder of a .ply file of each thing. [default: none]")
def catalog(folder: Path, **asked: Any) -> None:
    """List the things in the finished scene of FOLDER, each once, with place and size."""
    with without_collection():
        from egosplat.export.catalog import run

    for paragraph in run(folder, **asked):
        click.echo(paragraph)


# The keys of the page but those of OpenCLIP, which the scene tells.
@on_folder(PageOptions, "scene_page", "Look at a finished scene in the browser, and ask it.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen at.")
@click.option("--port", type=click.IntRange(0, 65535), default=8080, show_default=True, help="0: any.")
def view(folder: Path, host: str, port: int, options: PageOptions) -> None:
    """Show the finished scene of FOLDER, such as results/adt/scene1, in the browser."""
    from egosplat.viewing.command import run

    run(folder, options, host, port)


@on_folder(AskingOptions, "query", "Write a finished scene for other programs.")
@click.option(
    "--format",
    type=click.Choice(list(FORMATS)),
    help="Gaussians (ply, spz), a point cloud in the colors of instances, images with cameras (nerfstudio, colmap), the scene "
    "page (html), or all of these over time for Rerun (rrd). [default: by the suffix of --output; without one, ply]",
)
@click.option("--query", metavar="WORDS", help="Gaussians of the best answer (ply, spz), or boxes (rrd).")
@writes("Output file or folder. [default: a name in FOLDER]")
@click.option("--codes/--no-codes", default=True, show_default=True, help="Include the language codes; ply.")
def export(folder: Path, output: Path | None, options: AskingOptions, **asked: Any) -> None:
    """Write the finished scene of FOLDER, such as results/adt/scene1, for other programs."""
    export_scene(folder, output, options=options, **asked)


@on_folder(AskingOptions, "query", "Draw a moving picture of a scene that is asked.")
@click.argument("phrases", nargs=-1, required=True)
@writes("Output picture, .webp.  [default: FOLDER/query.webp]")
@click.option(
    "--side", type=click.IntRange(32, 4096), default=480, show_default=True, help="Longer side [px]."
)
def movie(folder: Path, output: Path | None, overwrite: bool, options: AskingOptions, **asked: Any) -> None:
    """Draw a moving picture of FOLDER that is asked for PHRASES: the camera goes to each answer."""
    output = _check_paths(folder, ASKED, "query.webp", output, overwrite)
    from egosplat.export.movie import run
    from egosplat.query.finished_scene import open_scene

    run(open_scene(folder, options), output=output, **asked)


@click.command(
    short_help="Make a scene of a video or photographs, and ask it.",
    help="Make a scene of SOURCE, which can be asked: a video, a folder or .zip of photographs, a folder of COLMAP or "
    "nerfstudio, or a .vrs of Aria glasses. Run again, it does what is new.",
)
@click.argument("source", type=ARTIFACT)
@click.argument("words", nargs=-1)
@click.option(
    "--preset", type=click.Choice(PRESET_NAMES), help="Speed or accuracy. [default: the configuration's]"
)
@click.option("--words", "asked", is_flag=True, help="Ask for WORDS at the end.")
@click.option("--open", "show", is_flag=True, help="Open its page in the browser at once.")
@click.option(
    "--name", metavar="DATASET/SCENE", help="Name of the scene. [default: mine/ and that of SOURCE]"
)
@click.option(
    "--set", "pairs", multiple=True, metavar="KEY=VALUE", help="Key of this scene. May be repeated."
)
@click.option("--cores", type=click.IntRange(1), help="Number of processors. [default: all]")
@click.option("--quiet", **QUIET)
def run(
    source: Path,
    name: str | None,
    preset: str | None,
    pairs: tuple[str, ...],
    cores: int | None,
    words: tuple[str, ...],
    asked: bool,
    show: bool,
) -> None:
    log(without_secrets(f"{source}: looking at the recording"))
    from egosplat.run.command import make_scene
    from egosplat.viewing.html import facts_of

    if bool(words) != asked or not all(map(str.strip, words)):
        raise click.UsageError("give one recording, and words to ask for behind --words, none of them empty")
    server, during = None, contextlib.nullcontext
    if show:
        from egosplat.viewing.growing import growing_page
        from egosplat.viewing.server import PageServer

        server = PageServer("127.0.0.1", 0)
        during = partial(growing_page, server)
    try:
        folder = make_scene(source, name, preset, pairs, cores, during).results
    except KeyboardInterrupt:
        click.echo("Stopped. Finished steps are kept: the same command goes on from here.", err=True)
        raise SystemExit(130) from None
    if words:
        assert query.callback is not None
        query.callback(folder, words, AskingOptions())
    where, logs, page = shlex.quote(str(folder)), Path("logs", *folder.parts[1:]), folder / "scene.html"
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    log(f"{folder} is ready, {size / 1e6:,.0f} MB; its page, to share: {page}; logs: {logs}", always=True)
    listed = facts_of(page.read_text("utf-8")).get("catalog", [])
    names = shlex.join([*dict.fromkeys(one["phrase"] for one in listed)][:3])
    log(f"  egosplat query {where} {names}    where is it?" if names else f"  egosplat catalog {where}")
    log(f"  {make_command(folder / 'story.html')}    pictures of each step, which alarms name")
    log(f"  egosplat view {where}    walk through the scene in the browser, ask it, click on things")
    if server:
        from egosplat.viewing.command import show as show_page

        show_page(server, folder, PageOptions())


COMMANDS = (run, query, catalog, name, calibrate, view, page, export, movie)

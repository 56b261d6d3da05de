"""Commands on the folder of a finished scene: ``query``, ``page``, ``view``, ``export`` and ``movie``.

Their keys come from the options of stages, so each is built only when it is called.
"""

from pathlib import Path

import click

from egosplat.cli.flags import ARTIFACT, KeysCommand
from egosplat.pipeline.scene_folder import check_scene_folder, title_of
from egosplat.pipeline.stages import STAGES, run_stage
from egosplat.query.options import AskingOptions
from egosplat.viewing.options import ScenePageOptions


def query_command() -> click.Command:
    """Build the command ``query``, with the keys of the section ``query``."""

    def call(
        folder: Path,
        phrases: tuple[str, ...],
        frame: int | None,
        pose: Path | None,
        most: int,
        output: Path | None,
        options: AskingOptions,
    ) -> None:
        from egosplat.query.command import Asking, run

        check_scene_folder(folder, ("frames", "poses", "splats", "language"))
        asking = Asking(frame, pose, most, output)
        how = {name: getattr(options, name) for name in ("backend", "device", "precision")}
        for part in run(folder, phrases, asking, options, **how):
            click.echo(part)

    return KeysCommand(
        "query",
        AskingOptions,
        "query",
        callback=call,
        params=[
            click.Argument(["folder"], type=ARTIFACT),
            click.Argument(["phrases"], nargs=-1, required=True),
            click.Option(
                ["--frame"],
                type=click.IntRange(min=0),
                help="Search only this frame. [default: the whole scene]",
            ),
            click.Option(
                ["--pose"],
                type=ARTIFACT,
                help='Search only this view: JSON file, {"camera_to_world": 4 rows of 4}.',
            ),
            click.Option(
                ["--most"],
                type=click.IntRange(min=1),
                default=3,
                show_default=True,
                help="Largest number of matches listed for the whole scene.",
            ),
            click.Option(["--output"], type=ARTIFACT, help="Output image, .png. [default: FOLDER/query.png]"),
        ],
        help="Find each of PHRASES in the finished scene of FOLDER, such as results/adt/scene1.",
    )


def _write_page(folder: Path, output: Path | None, title: str | None, options: ScenePageOptions) -> None:
    """Write the scene page of a finished scene."""
    from egosplat.artifacts.locating import locate

    stage = STAGES["scene_page"]
    check_scene_folder(folder, stage.inputs)
    paths = dict(zip(stage.inputs, locate(folder, *stage.inputs), strict=True))
    target = output or folder / stage.output
    run_stage(stage.name, options, **paths, output=target, title=title or title_of(folder))


def page_command() -> click.Command:
    """Build the command ``page``, with the keys of the stage ``scene_page``."""
    return KeysCommand(
        "page",
        ScenePageOptions,
        "scene_page",
        callback=_write_page,
        params=[
            click.Argument(["folder"], type=ARTIFACT),
            click.Option(
                ["--output"], type=ARTIFACT, help="Output page, .html. [default: FOLDER/scene.html]"
            ),
            click.Option(["--title"], help="Title of the scene. [default: dataset/scene]"),
        ],
        help="Write the finished scene of FOLDER as one HTML file to share: it answers queries in the browser.",
    )


def view_command() -> click.Command:
    """Build the command ``view``, with the keys of the section ``query``."""

    def call(
        folders: tuple[Path, ...],
        host: str,
        port: int,
        options: AskingOptions,
    ) -> None:
        from egosplat.viewer.command import run

        how = {name: getattr(options, name) for name in ("backend", "device", "precision")}
        run(folders, options, host=host, port=port, **how)

    return KeysCommand(
        "view",
        AskingOptions,
        "query",
        callback=call,
        params=[
            click.Argument(["folders"], nargs=-1, required=True, type=ARTIFACT),
            click.Option(
                ["--host"],
                default="127.0.0.1",
                show_default=True,
                help="Address to listen at. Others can look, too, where they reach it.",
            ),
            click.Option(
                ["--port"],
                type=click.IntRange(0, 65535),
                default=8080,
                show_default=True,
                help="0: any free port.",
            ),
        ],
        help="Show the finished scenes of FOLDERS, such as results/adt/scene1, in the browser.",
    )


def export_command() -> click.Command:
    """Build the command ``export``, with the keys of the section ``query``."""
    needs = {
        "ply": ("splats",),
        "spz": ("splats",),
        "instances": ("splats", "instances"),
        "nerfstudio": ("frames", "poses", "splats"),
        "colmap": ("frames", "poses", "splats"),
    }

    def call(
        folder: Path,
        format: str,
        output: Path | None,
        query: str | None,
        codes: bool,
        options: AskingOptions,
    ) -> None:
        if format == "html":
            _write_page(folder, output, None, ScenePageOptions.model_validate(dict(options)))
            return
        from egosplat.export.command import Exporting, run

        asked = ("frames", "poses", "language") if query is not None else ()
        coded = ("language",) if codes and format == "ply" else ()
        check_scene_folder(folder, dict.fromkeys((*needs[format], *asked, *coded)))
        how = {name: getattr(options, name) for name in ("backend", "device", "precision")}
        run(folder, Exporting(format, output, query, codes), options, **how)

    return KeysCommand(
        "export",
        AskingOptions,
        "query",
        callback=call,
        params=[
            click.Argument(["folder"], type=ARTIFACT),
            click.Option(
                ["--format"],
                type=click.Choice([*needs, "html"]),
                default="ply",
                show_default=True,
                help="Gaussians (ply, spz), a point cloud in the colors of instances, images with cameras (nerfstudio, "
                "colmap), or the scene page (html).",
            ),
            click.Option(
                ["--query"], metavar="WORDS", help="Only the Gaussians of the best answer; ply and spz."
            ),
            click.Option(
                ["--output"], type=ARTIFACT, help="Output file or folder.  [default: a name in FOLDER]"
            ),
            click.Option(
                ["--codes/--no-codes"],
                default=True,
                show_default=True,
                help="Include the language codes; ply.",
            ),
        ],
        help="Write the finished scene of FOLDER, such as results/adt/scene1, for other programs.",
    )


def movie_command() -> click.Command:
    """Build the command ``movie``, with the keys of the section ``query``."""

    def call(
        folder: Path,
        phrases: tuple[str, ...],
        output: Path | None,
        side: int,
        options: AskingOptions,
    ) -> None:
        check_scene_folder(folder, ("frames", "poses", "splats", "language"))
        from egosplat.export.movie import run

        how = {name: getattr(options, name) for name in ("backend", "device", "precision")}
        run(folder, phrases, output or folder / "query.webp", side, options, **how)

    return KeysCommand(
        "movie",
        AskingOptions,
        "query",
        callback=call,
        params=[
            click.Argument(["folder"], type=ARTIFACT),
            click.Argument(["phrases"], nargs=-1, required=True),
            click.Option(
                ["--output"], type=ARTIFACT, help="Output picture, .webp.  [default: FOLDER/query.webp]"
            ),
            click.Option(
                ["--side"],
                type=click.IntRange(32, 4096),
                default=480,
                show_default=True,
                help="Longer side of the picture [px].",
            ),
        ],
        help="Draw a moving picture of FOLDER that is asked for PHRASES: the camera goes to each answer.",
    )

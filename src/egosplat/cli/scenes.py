"""Commands on the folder of a finished scene: ``query``, ``page``, ``view``, ``export`` and ``movie``.

Their flags come from the configuration's schema, so each is built only when it is called.
"""

from pathlib import Path
from typing import Any

import click

from egosplat.cli.flags import ARTIFACT, OVERWRITE, flag, query_flags
from egosplat.files import check_output
from egosplat.pipeline.config import stage_keys
from egosplat.pipeline.scene_folder import check_scene_folder, title_of
from egosplat.pipeline.stages import STAGES, run_stage


def query_command() -> click.Command:
    """Build the command ``query``, with a flag for each key of the section ``query``."""

    def call(
        folder: Path,
        phrases: tuple[str, ...],
        frame: int | None,
        pose: Path | None,
        most: int,
        output: Path | None,
        overwrite: bool,
        backend: str,
        device: str,
        precision: str,
        **keys: Any,
    ) -> None:
        from egosplat.query.command import Asking, run
        from egosplat.query.options import QueryOptions

        check_scene_folder(folder, ("frames", "poses", "splats", "language"))
        output = output or folder / "query.png"
        check_output(output, "query.png", overwrite=overwrite)
        asking, options = Asking(frame, pose, most, output), QueryOptions(**keys)
        how = {"backend": backend, "device": device, "precision": precision}
        for part in run(folder, phrases, asking, options, **how):
            click.echo(part)

    return click.Command(
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
            click.Option(["--overwrite"], **OVERWRITE),
            *query_flags(),
        ],
        help="Find each of PHRASES in the finished scene of FOLDER, such as results/adt/scene1.",
    )


def page_command() -> click.Command:
    """Build the command ``page``, with the flags of the stage ``scene_page`` but its paths."""
    stage = "scene_page"

    def call(folder: Path, output: Path | None, overwrite: bool, title: str | None, **keys: Any) -> None:
        from egosplat.artifacts.locating import locate

        inputs = STAGES[stage].inputs
        check_scene_folder(folder, inputs)
        paths = dict(zip(inputs, locate(folder, *inputs), strict=True))
        target = output or folder / STAGES[stage].output
        check_output(target, STAGES[stage].output, overwrite=overwrite)
        run_stage(stage, keys, **paths, output=target, title=title or title_of(folder))

    return click.Command(
        "page",
        callback=call,
        params=[
            click.Argument(["folder"], type=ARTIFACT),
            click.Option(
                ["--output"], type=ARTIFACT, help="Output page, .html. [default: FOLDER/scene.html]"
            ),
            click.Option(["--overwrite"], **OVERWRITE),
            click.Option(["--title"], help="Title of the scene. [default: dataset/scene]"),
            *(flag(name, key) for name, key in stage_keys(stage).items()),
        ],
        help="Write the finished scene of FOLDER as one HTML file to share: it answers queries in the browser.",
    )


def view_command() -> click.Command:
    """Build the command ``view``, with the flags of the page but those of OpenCLIP, which the scene tells."""

    def call(folder: Path, host: str, port: int, **keys: Any) -> None:
        from egosplat.viewing.command import run

        run(folder, keys, host, port)

    known = {"clip_model", "clip_checkpoint"}
    return click.Command(
        "view",
        callback=call,
        params=[
            click.Argument(["folder"], type=ARTIFACT),
            click.Option(
                ["--host"],
                default="127.0.0.1",
                show_default=True,
                help="Address to listen at. Other computers need the whole address that is printed.",
            ),
            click.Option(
                ["--port"],
                type=click.IntRange(0, 65535),
                default=8080,
                show_default=True,
                help="0: any free port.",
            ),
            *(flag(name, key) for name, key in stage_keys("scene_page").items() if name not in known),
        ],
        help="Show the finished scene of FOLDER, such as results/adt/scene1, in the browser.",
    )


def export_command() -> click.Command:
    """Build the command ``export``, with a flag for each key of the section ``query``."""
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
        overwrite: bool,
        query: str | None,
        codes: bool,
        backend: str,
        device: str,
        precision: str,
        **keys: Any,
    ) -> None:
        if format == "html":
            click.get_current_context().invoke(
                page_command(), folder=folder, output=output, overwrite=overwrite
            )
            return
        from egosplat.export.command import Exporting, own_name, run
        from egosplat.query.options import QueryOptions

        asked = ("frames", "poses", "language") if query is not None else ()
        coded = ("language",) if codes and format == "ply" else ()
        check_scene_folder(folder, dict.fromkeys((*needs[format], *asked, *coded)))
        how = {"backend": backend, "device": device, "precision": precision}
        what = Exporting(format, output or folder / own_name(format, query), query, codes)
        if Path(own_name(format, query)).suffix:
            check_output(what.output, own_name(format, query), overwrite=overwrite)
        run(folder, what, QueryOptions(**keys), **how)

    return click.Command(
        "export",
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
            click.Option(["--overwrite"], **OVERWRITE),
            click.Option(
                ["--codes/--no-codes"],
                default=True,
                show_default=True,
                help="Include the language codes; ply.",
            ),
            *query_flags(),
        ],
        help="Write the finished scene of FOLDER, such as results/adt/scene1, for other programs.",
    )


def movie_command() -> click.Command:
    """Build the command ``movie``, with a flag for each key of the section ``query``."""

    def call(
        folder: Path,
        phrases: tuple[str, ...],
        output: Path | None,
        overwrite: bool,
        side: int,
        backend: str,
        device: str,
        precision: str,
        **keys: Any,
    ) -> None:
        check_scene_folder(folder, ("frames", "poses", "splats", "language"))
        output = output or folder / "query.webp"
        check_output(output, "query.webp", overwrite=overwrite)
        from egosplat.export.movie import run
        from egosplat.query.options import QueryOptions

        how = {"backend": backend, "device": device, "precision": precision}
        run(folder, phrases, output, side, QueryOptions(**keys), **how)

    return click.Command(
        "movie",
        callback=call,
        params=[
            click.Argument(["folder"], type=ARTIFACT),
            click.Argument(["phrases"], nargs=-1, required=True),
            click.Option(
                ["--output"], type=ARTIFACT, help="Output picture, .webp.  [default: FOLDER/query.webp]"
            ),
            click.Option(["--overwrite"], **OVERWRITE),
            click.Option(
                ["--side"],
                type=click.IntRange(32, 4096),
                default=480,
                show_default=True,
                help="Longer side of the picture [px].",
            ),
            *query_flags(),
        ],
        help="Draw a moving picture of FOLDER that is asked for PHRASES: the camera goes to each answer.",
    )

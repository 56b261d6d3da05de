"""Commands on the folder of a finished scene: ``query``, ``page``, ``view``, ``export`` and ``movie``.

Their keys come from the options of stages, so each is built only when it is called.
"""

from pathlib import Path

import click

from egosplat.cli.flags import ARTIFACT, OVERWRITE, KeysCommand
from egosplat.export.formats import FORMATS, plan_export
from egosplat.files import check_output
from egosplat.pipeline.scene_folder import ASKED, check_scene_folder
from egosplat.pipeline.stages import STAGES
from egosplat.query.options import AskingOptions
from egosplat.viewing.options import PageOptions, ScenePageOptions

FOLDER = click.Argument(["folder"], type=ARTIFACT)
PHRASES = click.Argument(["phrases"], nargs=-1, required=True)
# Keys with a flag of their own; --help-all lists the others, for --set.
PLAIN = ("min_score",)
# Matches that an answer of the whole scene lists.
MOST = 3
REPLACE = click.Option(["--overwrite"], **OVERWRITE)


def ask(
    folder: Path,
    phrases: tuple[str, ...],
    options: AskingOptions,
    output: Path,
    frame: int | None = None,
    pose: Path | None = None,
    most: int = MOST,
) -> None:
    """Print the answers of a scene, and draw them; arguments as the flags of ``query``."""
    from egosplat.query.command import run
    from egosplat.query.opening import open_scene

    scene = open_scene(folder, options)
    for part in run(scene, phrases, scene.viewpoint(frame, pose), most, output):
        click.echo(part)


def query_command() -> click.Command:
    """Build the command ``query``, with the keys of the section ``query``."""

    def call(
        folder: Path,
        phrases: tuple[str, ...],
        frame: int | None,
        pose: Path | None,
        most: int,
        output: Path | None,
        overwrite: bool,
        options: AskingOptions,
    ) -> None:
        check_scene_folder(folder, ASKED)
        output = output or folder / "query.png"
        check_output(output, "query.png", overwrite=overwrite)
        ask(folder, phrases, options, output, frame, pose, most)

    return KeysCommand(
        "query",
        AskingOptions,
        "query",
        callback=call,
        params=[
            FOLDER,
            PHRASES,
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
                default=MOST,
                show_default=True,
                help="Largest number of matches listed for the whole scene.",
            ),
            click.Option(["--output"], type=ARTIFACT, help="Output image, .png. [default: FOLDER/query.png]"),
            REPLACE,
        ],
        plain=PLAIN,
        help="Find each of PHRASES in the finished scene of FOLDER, such as results/adt/scene1.",
    )


def page_command() -> click.Command:
    """Build the command ``page``, with the keys of the stage ``scene_page``."""
    stage = STAGES["scene_page"]

    def call(
        folder: Path, output: Path | None, overwrite: bool, title: str | None, options: ScenePageOptions
    ) -> None:
        check_scene_folder(folder, stage.inputs)
        target = output or folder / stage.output
        check_output(target, stage.output, overwrite=overwrite)
        from egosplat.export.page import write_page

        write_page(folder, target, options, title)

    return KeysCommand(
        "page",
        ScenePageOptions,
        "scene_page",
        callback=call,
        params=[
            FOLDER,
            click.Option(
                ["--output"], type=ARTIFACT, help="Output page, .html. [default: FOLDER/scene.html]"
            ),
            REPLACE,
            click.Option(["--title"], help="Title of the scene. [default: dataset/scene]"),
        ],
        plain=PLAIN,
        help="Write the finished scene of FOLDER as one HTML file to share: it answers queries in the browser.",
    )


def view_command() -> click.Command:
    """Build the command ``view``, with the keys of the page but those of OpenCLIP, which the scene tells."""

    def call(folder: Path, host: str, port: int, options: PageOptions) -> None:
        from egosplat.viewing.command import run

        run(folder, dict(options), host, port)

    return KeysCommand(
        "view",
        PageOptions,
        "scene_page",
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
        ],
        plain=PLAIN,
        help="Show the finished scene of FOLDER, such as results/adt/scene1, in the browser.",
    )


def export_command() -> click.Command:
    """Build the command ``export``, with the keys of the section ``query``."""

    def call(
        folder: Path,
        format: str | None,
        output: Path | None,
        overwrite: bool,
        query: str | None,
        codes: bool,
        options: AskingOptions,
    ) -> None:
        what = plan_export(folder, output, format=format, query=query, codes=codes, overwrite=overwrite)
        from egosplat.export.command import run

        run(folder, what, options)

    return KeysCommand(
        "export",
        AskingOptions,
        "query",
        callback=call,
        params=[
            FOLDER,
            click.Option(
                ["--format"],
                type=click.Choice(list(FORMATS)),
                help="Gaussians (ply, spz), a point cloud in the colors of instances, images with cameras (nerfstudio, "
                "colmap), or the scene page (html). [default: by the suffix of --output, else ply]",
            ),
            click.Option(
                ["--query"], metavar="WORDS", help="Only the Gaussians of the best answer; ply and spz."
            ),
            click.Option(
                ["--output"], type=ARTIFACT, help="Output file or folder.  [default: a name in FOLDER]"
            ),
            REPLACE,
            click.Option(
                ["--codes/--no-codes"],
                default=True,
                show_default=True,
                help="Include the language codes; ply.",
            ),
        ],
        plain=PLAIN,
        help="Write the finished scene of FOLDER, such as results/adt/scene1, for other programs.",
    )


def movie_command() -> click.Command:
    """Build the command ``movie``, with the keys of the section ``query``."""

    def call(
        folder: Path,
        phrases: tuple[str, ...],
        output: Path | None,
        overwrite: bool,
        side: int,
        options: AskingOptions,
    ) -> None:
        check_scene_folder(folder, ASKED)
        output = output or folder / "query.webp"
        check_output(output, "query.webp", overwrite=overwrite)
        from egosplat.export.movie import run
        from egosplat.query.opening import open_scene

        run(open_scene(folder, options), phrases, output, side)

    return KeysCommand(
        "movie",
        AskingOptions,
        "query",
        callback=call,
        params=[
            FOLDER,
            PHRASES,
            click.Option(
                ["--output"], type=ARTIFACT, help="Output picture, .webp.  [default: FOLDER/query.webp]"
            ),
            REPLACE,
            click.Option(
                ["--side"],
                type=click.IntRange(32, 4096),
                default=480,
                show_default=True,
                help="Longer side of the picture [px].",
            ),
        ],
        plain=PLAIN,
        help="Draw a moving picture of FOLDER that is asked for PHRASES: the camera goes to each answer.",
    )

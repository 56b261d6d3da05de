"""The command line: a sub-command for each stage, with the stage's configuration keys as flags."""

import json
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

import egosplat
from egosplat.errors import UserError, user_message
from egosplat.pipeline.config import schema, section_keys, stage_keys
from egosplat.pipeline.config_table import keys_page
from egosplat.pipeline.process_guards import end_with_snakemake
from egosplat.pipeline.scene_folder import check_scene_folder, title_of
from egosplat.pipeline.stages import STAGES, path_help, run_stage
from egosplat.pipeline.strict_yaml import NO_YAML, load_yaml
from egosplat.pipeline.validation import LARGEST_INTEGER
from egosplat.progress import show_log

# Half of the longest message about a flag [characters]; a value may be a whole file.
_LONGEST = 500

ARTIFACT = click.Path(path_type=Path)

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


class Commands(click.Group):
    """Sub-commands that are built only when they are called."""

    def list_commands(self, context: click.Context) -> list[str]:
        others = sorted([*super().list_commands(context), *_BUILT])
        return [*(name.replace("_", "-") for name in STAGES), *others]

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        # Built on demand, so that ``--help`` imports neither PyTorch nor a stage.
        if name in _BUILT:
            return _BUILT[name]()
        stage = name.replace("-", "_")
        return stage_command(stage) if stage in STAGES else super().get_command(context, name)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(egosplat.__version__, message="egosplat %(version)s")
def cli() -> None:
    """Search a 3D scene, filmed by a head-mounted camera, by text.

    Each stage of the pipeline is a command. The workflow calls them in order and reruns only what is stale:
    snakemake --cores 2 results/adt/scene1/contact_sheet.png
    """


@cli.command()
@click.argument("folders", nargs=-1, required=True, type=ARTIFACT)
def check(folders: tuple[Path, ...]) -> None:
    """Verify all artifacts and JSON files below FOLDERS: checksums, schemas, and the artifacts they were made from."""
    from egosplat.artifacts.check import check_tree

    problems = sum(not report.sound for folder in folders for report in check_tree(folder, click.echo))
    if problems:
        raise UserError(f"{problems} artifact{'s are' if problems > 1 else ' is'} not sound")


@cli.command()
@click.argument("metrics", nargs=-1, type=ARTIFACT)
@click.option("--output", type=ARTIFACT, required=True, help="Output folder of the tables.")
@click.option(
    "--picture", "pictures", multiple=True, type=ARTIFACT, help="Figure on the page. May be repeated."
)
def tables(metrics: tuple[Path, ...], output: Path, pictures: tuple[Path, ...]) -> None:
    """Write METRICS, metrics.json of several scenes, as the paper's tables, next to its printed numbers."""
    from egosplat.tables.stage import run

    run(metrics, output, pictures=pictures)


@cli.command()
@click.option(
    "--points",
    type=JSON,
    required=True,
    help="Settings and metrics.json files of each point; the scene itself first.",
)
@click.option("--output", type=ARTIFACT, required=True, help="Output folder of the page.")
def tradeoff(points: list[dict[str, Any]], output: Path) -> None:
    """Compare cost and accuracy of points. The workflow lists the points."""
    from egosplat.tradeoff.stage import run

    run(points, output)


@cli.command()
@click.argument("documents", nargs=-1, required=True, type=ARTIFACT)
@click.option("--output", type=ARTIFACT, required=True, help="Output folder of the page.")
def tradeoff_scenes(documents: tuple[Path, ...], output: Path) -> None:
    """Compare cost and accuracy over several scenes: DOCUMENTS are their files tradeoff.json."""
    from egosplat.tradeoff.stage import run_scenes

    run_scenes(documents, output)


@cli.command()
@click.argument("metrics", nargs=-1, required=True, type=ARTIFACT)
@click.option("--title", required=True, help="Name of the scene.")
@click.option("--output", type=ARTIFACT, required=True, help="Output picture, .png.")
def methods_sheet(metrics: tuple[Path, ...], title: str, output: Path) -> None:
    """Draw answers of methods side by side: METRICS are metrics.json of one scene's variants."""
    from egosplat.report.methods_sheet import run

    run(metrics, output, title)


@cli.command()
@click.argument("files", nargs=-1, required=True, type=ARTIFACT)
@click.option("--title", required=True, help="Name of the scene.")
@click.option("--output", type=ARTIFACT, required=True, help="Output page, .html.")
def story(files: tuple[Path, ...], title: str, output: Path) -> None:
    """Tell on one page what became of a scene: FILES are its artifacts, pages, survey.json and metrics.json."""
    from egosplat.report.story import run

    run(files, output, title)


@cli.command()
def keys() -> None:
    """Print all configuration keys with defaults and descriptions as a Markdown page."""
    click.echo(keys_page())


CONFIGFILE = click.option(
    "--configfile", multiple=True, type=ARTIFACT, help="Overrides config/config.yaml. May be repeated."
)
CONFIG = click.option(
    "--config", multiple=True, metavar="KEY=VALUE", help="Overrides all files, as in preset=fast."
)


@cli.command()
@CONFIGFILE
@CONFIG
def doctor(configfile: tuple[Path, ...], config: tuple[str, ...]) -> None:
    """Report what this machine can do with the configuration and what is missing (exit status 1)."""
    from egosplat.doctor.examination import examine
    from egosplat.doctor.findings import Mark, page

    findings = examine(configfile, config)
    click.echo(page(findings))
    if any(finding.mark == Mark.MISSING for finding in findings):
        raise SystemExit(1)


@cli.group(invoke_without_command=True)
@CONFIGFILE
@CONFIG
@click.option("--all", "every", is_flag=True, help="List the whole catalogue of published checkpoints.")
@click.pass_context
def models(
    context: click.Context, configfile: tuple[Path, ...], config: tuple[str, ...], every: bool
) -> None:
    """List the checkpoints that the configuration needs: place, licence, size, SHA-256, and whether they are there."""
    from egosplat.doctor.inputs import read_configuration, read_configurations
    from egosplat.models.needed import catalogue, listing, needed

    context.obj = (configfile, config)
    if context.invoked_subcommand:
        return
    options = [word for path in configfile for word in ("--configfile", str(path))]
    options += [word for one in config for word in ("--config", one)]
    files = (
        catalogue(read_configuration(configfile, config)[0])
        if every
        else needed(read_configurations(configfile, config))
    )
    click.echo(listing(files, options))


@models.command()
@click.argument("names", nargs=-1)
@CONFIGFILE
@CONFIG
@click.pass_context
def download(
    context: click.Context, names: tuple[str, ...], configfile: tuple[Path, ...], config: tuple[str, ...]
) -> None:
    """Fetch the published checkpoints that the configuration needs and that are missing, or those of NAMES.

    NAMES are architectures, as sam2.1_hiera_l. An interrupted download continues. Proxies are those of the environment
    (https_proxy); HF_ENDPOINT names a mirror of the Hugging Face hub. Nothing else in egosplat downloads anything.
    """
    from egosplat.doctor.inputs import read_configuration, read_configurations
    from egosplat.models.needed import catalogue, needed
    from egosplat.models.needed import download as fetch

    files, options = (*context.obj[0], *configfile), (*context.obj[1], *config)
    if names:
        wanted = catalogue(read_configuration(files, options)[0], names)
    else:
        wanted = needed(read_configurations(files, options))
    for line in fetch(wanted):
        click.echo(line)


def query_command() -> click.Command:
    """Build the command ``query``, with a flag for each key of the section ``query``."""

    def call(
        folder: Path,
        phrases: tuple[str, ...],
        frame: int | None,
        pose: Path | None,
        most: int,
        output: Path | None,
        backend: str,
        device: str,
        precision: str,
        **keys: Any,
    ) -> None:
        from egosplat.query.options import QueryOptions
        from egosplat.report.query_command import Asking, run

        check_scene_folder(folder, ("frames", "poses", "splats", "language"))
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
            *_query_flags(),
        ],
        help="Find each of PHRASES in the finished scene of FOLDER, such as results/adt/scene1.",
    )


def page_command() -> click.Command:
    """Build the command ``page``, with the flags of the stage ``scene_page`` but its paths."""
    stage = "scene_page"

    def call(folder: Path, output: Path | None, title: str | None, **keys: Any) -> None:
        from egosplat.artifacts.locating import locate

        inputs = STAGES[stage].inputs
        check_scene_folder(folder, inputs)
        paths = dict(zip(inputs, locate(folder, *inputs), strict=True))
        target = output or folder / STAGES[stage].output
        run_stage(stage, keys, **paths, output=target, title=title or title_of(folder))

    return click.Command(
        "page",
        callback=call,
        params=[
            click.Argument(["folder"], type=ARTIFACT),
            click.Option(
                ["--output"], type=ARTIFACT, help="Output page, .html. [default: FOLDER/scene.html]"
            ),
            click.Option(["--title"], help="Title of the scene. [default: dataset/scene]"),
            *(_flag(name, key) for name, key in stage_keys(stage).items()),
        ],
        help="Write the finished scene of FOLDER as one HTML file to share: it answers queries in the browser.",
    )


def view_command() -> click.Command:
    """Build the command ``view``, with a flag for each key of the section ``query``."""

    def call(
        folders: tuple[Path, ...],
        host: str,
        port: int,
        backend: str,
        device: str,
        precision: str,
        **keys: Any,
    ) -> None:
        from egosplat.query.options import QueryOptions
        from egosplat.viewer.command import run

        how = {"backend": backend, "device": device, "precision": precision}
        run(folders, QueryOptions(**keys), host=host, port=port, **how)

    return click.Command(
        "view",
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
            *_query_flags(),
        ],
        help="Show the finished scenes of FOLDERS, such as results/adt/scene1, in the browser.",
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
        query: str | None,
        codes: bool,
        backend: str,
        device: str,
        precision: str,
        **keys: Any,
    ) -> None:
        if format == "html":
            click.get_current_context().invoke(page_command(), folder=folder, output=output)
            return
        from egosplat.export.command import Exporting, run
        from egosplat.query.options import QueryOptions

        asked = ("frames", "poses", "language") if query is not None else ()
        coded = ("language",) if codes and format == "ply" else ()
        check_scene_folder(folder, dict.fromkeys((*needs[format], *asked, *coded)))
        how = {"backend": backend, "device": device, "precision": precision}
        run(folder, Exporting(format, output, query, codes), QueryOptions(**keys), **how)

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
            click.Option(
                ["--codes/--no-codes"],
                default=True,
                show_default=True,
                help="Include the language codes; ply.",
            ),
            *_query_flags(),
        ],
        help="Write the finished scene of FOLDER, such as results/adt/scene1, for other programs.",
    )


def movie_command() -> click.Command:
    """Build the command ``movie``, with a flag for each key of the section ``query``."""

    def call(
        folder: Path,
        phrases: tuple[str, ...],
        output: Path | None,
        side: int,
        backend: str,
        device: str,
        precision: str,
        **keys: Any,
    ) -> None:
        check_scene_folder(folder, ("frames", "poses", "splats", "language"))
        from egosplat.export.movie import run
        from egosplat.query.options import QueryOptions

        how = {"backend": backend, "device": device, "precision": precision}
        run(folder, phrases, output or folder / "query.webp", side, QueryOptions(**keys), **how)

    return click.Command(
        "movie",
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
            *_query_flags(),
        ],
        help="Draw a moving picture of FOLDER that is asked for PHRASES: the camera goes to each answer.",
    )


# Commands that are built on demand: their flags come from the configuration's schema.
_BUILT: dict[str, Callable[[], click.Command]] = {
    "export": export_command,
    "movie": movie_command,
    "query": query_command,
    "page": page_command,
    "view": view_command,
}


def _query_flags() -> list[click.Option]:
    models = {name: section_keys("models")[name] for name in ("device", "precision")}
    return [_flag(name, key) for name, key in {**section_keys("query"), **models}.items()]


def stage_command(stage: str) -> click.Command:
    """Build the command of a stage, with a flag for each path and each configuration key."""

    def call(**values: Any) -> None:
        from egosplat.alarms.artifact_alarms import log_warnings

        keys = {name: values.pop(name) for name in stage_keys(stage)}
        run_stage(stage, keys, **values)
        log_warnings(stage, values["output"])

    return click.Command(
        stage.replace("_", "-"), callback=call, params=_flags(stage), help=STAGES[stage].help
    )


def _flags(stage: str) -> list[click.Parameter]:
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
    keys = (_flag(name, key) for name, key in stage_keys(stage).items())
    return [*paths, *(SCENE[name] for name in about.scene), *keys]


def _flag(name: str, key: dict[str, Any]) -> click.Option:
    flag = "--" + name.replace("_", "-")
    common: dict[str, Any] = {"default": key["default"], "show_default": True, "help": key["description"]}
    if "enum" in key:
        return click.Option([flag, name], type=click.Choice(key["enum"]), **common)
    kind = key["type"] if isinstance(key["type"], str) else key["type"][0]
    if kind == "boolean":
        return click.Option([f"{flag}/--no-{flag[2:]}"], **common)
    if kind == "array":
        return click.Option([flag, name], type=TextList(key.get("minItems", 0)), **common)
    if kind == "string":
        return click.Option([flag, name], **common)
    number = _range(kind, key)
    word = key.get("pattern", "").strip("^$")
    return click.Option([flag, name], type=OrWord(number, word) if word else number, **common)


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


def main() -> None:
    """Run the command line. A user's mistake gives one or two lines without a traceback and exit status 2."""
    # torch reads it on import. Waiting threads that spin take cores from working ones: on two shared cores training was
    # 3 to 7 times slower.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    end_with_snakemake()
    show_log()
    try:
        cli.main(standalone_mode=False)
    except click.ClickException as error:
        error.message = _shortened(error.message)
        error.show()
        sys.exit(2)
    except click.Abort:
        sys.exit(_say("interrupted", 130))
    except Exception as error:
        if (message := user_message(error)) is None:
            raise
        sys.exit(_say(message))


def _shortened(message: str) -> str:
    """Cut the middle out of a very long message."""
    return message if len(message) <= 2 * _LONGEST else f"{message[:_LONGEST]} ... {message[-_LONGEST:]}"


def _say(message: str, status: int = 2) -> int:
    click.echo(f"egosplat: {message}", err=True)
    return status


if __name__ == "__main__":
    main()

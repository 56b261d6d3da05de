"""The command line: a sub-command for each stage, with the stage's paths as flags and its keys in ``--set``."""

import atexit
import contextlib
import difflib
import gc
import os
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import click

import egosplat
from egosplat.cli import scenes
from egosplat.cli.flags import ARTIFACT, OVERWRITE, KeysCommand, path_flags, without_collection
from egosplat.errors import UserError, user_message
from egosplat.files import check_output
from egosplat.pipeline.config import stage_options
from egosplat.pipeline.config_table import keys_page
from egosplat.pipeline.costs import lack_of_memory
from egosplat.pipeline.home import SNAKEFILE, find_home
from egosplat.pipeline.options import Options
from egosplat.pipeline.process_guards import STARTED_BY, end_with_snakemake
from egosplat.pipeline.stages import FILES, STAGES, run_stage
from egosplat.progress import log, name_lines, show_log

# The groups of commands in ``--help``; all others are stages, or pages of several scenes.
_GROUPS = {
    "Make a scene": ("run",),
    "Ask and look": ("query", "catalog", "name", "calibrate", "view", "page", "export", "movie", "check"),
    "Set up": ("doctor", "models", "keys", "snakefile"),
}


class Commands(click.Group):
    """Sub-commands; those of stages are built only when they are called, so that ``--help`` imports no stage."""

    def list_commands(self, context: click.Context) -> list[str]:
        return [*(name.replace("_", "-") for name in STAGES), *super().list_commands(context)]

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        stage = name.replace("-", "_")
        command = stage_command(stage) if stage in STAGES else super().get_command(context, name)
        if command is None and (near := difflib.get_close_matches(name, self.list_commands(context), n=1)):
            context.fail(f"There is no command {name!r}. Did you mean {near[0]!r}?")
        return command

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands by group, one line each."""
        lines = {name.replace("_", "-"): stage.help for name, stage in STAGES.items()}
        lines |= {name: command.get_short_help_str(100) for name, command in self.commands.items()}
        named = {name for names in _GROUPS.values() for name in names}
        others = [name for name in lines if name not in named]
        for title, names in {**_GROUPS, "Stages, which the workflow calls": others}.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(max(map(len, others))), lines[name]) for name in names])


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(egosplat.__version__, message="egosplat %(version)s")
def cli() -> None:
    """Search a 3D scene, filmed by a head-mounted camera, by text.

    Each stage of the pipeline is a command. The workflow calls them in order and reruns only what is stale:

    \b
    snakemake --snakefile "$(egosplat snakefile)" --cores 2 results/adt/scene1/contact_sheet.png
    """


for command in scenes.COMMANDS:
    cli.add_command(command)


@cli.command(short_help="Verify artifacts: checksums, schemas, what they come from.")
@click.argument("folders", nargs=-1, required=True, type=ARTIFACT)
def check(folders: tuple[Path, ...]) -> None:
    """Verify all artifacts and JSON files below FOLDERS: checksums, schemas, and the artifacts they were made from."""
    from egosplat.artifacts.lineage import check_tree

    found = [problem for folder in folders for problem in check_tree(folder, click.echo).values()]
    if problems := len(list(filter(None, found))):
        raise UserError(f"{problems} artifact{'s are' if problems > 1 else ' is'} not sound")


@cli.command(short_help="Tell on one page what became of a scene.")
@click.argument("files", nargs=-1, required=True, type=ARTIFACT)
@click.option("--title", required=True, help="Name of the scene.")
@click.option("--output", type=ARTIFACT, required=True, help="Output page, .html.")
@click.option("--overwrite", **OVERWRITE)
def story(files: tuple[Path, ...], title: str, output: Path, overwrite: bool) -> None:
    """Tell on one page what became of a scene: FILES are its artifacts, pages, survey.json and metrics.json."""
    from egosplat.report.story import run

    check_output(output, "story.html", overwrite=overwrite)
    run(files, output, title)


@cli.command(short_help="Print all configuration keys as a Markdown page.")
def keys() -> None:
    """Print all configuration keys with defaults and descriptions as a Markdown page."""
    click.echo(keys_page())


@cli.command(name="snakefile")
def print_snakefile() -> None:
    """Print the path of the workflow, for snakemake --snakefile."""
    click.echo(find_home(SNAKEFILE).absolute())


CONFIGFILE = click.option("--configfile", multiple=True, type=ARTIFACT, help="Overrides config/config.yaml.")
CONFIG = click.option("--config", multiple=True, metavar="KEY=VALUE", help="Overrides files: preset=draft.")


@cli.command(short_help="Report what this machine can do and what is missing.")
@CONFIGFILE
@CONFIG
def doctor(configfile: tuple[Path, ...], config: tuple[str, ...]) -> None:
    """Report what this machine can do with the configuration and what is missing (exit status 1)."""
    from egosplat.doctor.findings import Mark, page
    from egosplat.doctor.inputs import examine

    findings = examine(configfile, config)
    click.echo(page(findings))
    if any(finding.mark == Mark.MISSING for finding in findings):
        raise SystemExit(1)


@cli.command(short_help="List and download the checkpoints that are needed.")
@click.argument("action", required=False, type=click.Choice(["download"]))
@click.argument("names", nargs=-1)
@CONFIGFILE
@CONFIG
@click.option("--all", "every", is_flag=True, help="The whole catalogue of published checkpoints.")
def models(
    action: str | None,
    names: tuple[str, ...],
    configfile: tuple[Path, ...],
    config: tuple[str, ...],
    every: bool,
) -> None:
    """List the checkpoints that the configuration needs: place, license, size, SHA-256, and whether they are there.

    With download, fetch those that are missing, or those of NAMES: architectures, as sam2.1_hiera_l. Proxies are those of the environment
    (https_proxy); HF_ENDPOINT names a mirror of the Hugging Face hub. egosplat run fetches what it needs; steps download nothing."""
    from egosplat.doctor.inputs import read_configuration, read_configurations
    from egosplat.models.needed import catalogue, download, find_needed, listing

    if every or names:
        needed = catalogue(read_configuration(configfile, config)[0], names)
    else:
        needed = find_needed(read_configurations(configfile, config))
    if action:
        download(needed)
    options = [word for path in configfile for word in ("--configfile", str(path))]
    click.echo(listing(needed, [*options, *(word for pair in config for word in ("--config", pair))]))


def stage_command(stage: str) -> click.Command:
    """Build the command of a stage, with a flag for each path, and ``--set`` for its keys."""

    def call(options: Options | None = None, **paths: Any) -> None:
        with without_collection():
            from egosplat.alarms.artifact_alarms import log_warnings

            import_module(STAGES[stage].module)
        if is_step := STARTED_BY in os.environ:
            name_lines(stage)
            # How long the result took the last time, as Snakemake measured it beside the log.
            with contextlib.suppress(OSError, IndexError):
                measured = Path("logs", *paths["output"].with_suffix(".tsv").parts[1:]).read_text()
                log("took {1} the last time [h:m:s]".format(*measured.splitlines()[1].split("\t")))
        if told := lack_of_memory(stage, dict(options or {}), paths.get("frames"), bool(paths.get("chunk"))):
            log(f"warning: {told}")
        if stage in FILES:
            check_output(paths["output"], STAGES[stage].output, overwrite=paths.pop("overwrite"))
        run_stage(stage, options, **paths)
        if paths.get("chunk") is None:
            log_warnings(stage, paths["output"], is_step=is_step)

    about = {"callback": call, "params": path_flags(stage), "help": STAGES[stage].help}
    name, keys = stage.replace("_", "-"), stage_options(stage)
    return KeysCommand(name, keys, stage, **about) if keys else click.Command(name, **about)


def main() -> None:
    """Run the command line ``egosplat``."""
    run_commands(cli)


def run_commands(group: click.Group) -> None:
    """Run a command line. A user's mistake gives one or two lines without a traceback and exit status 2."""
    # huggingface_hub reads it on import. A download asks for its file and for nothing else.
    os.environ.setdefault("HF_HUB_DISABLE_TELEMETRY", "1")
    _open_closed_streams()
    end_with_snakemake()
    # The operating system frees objects faster at the end; Triton reports each of its own that is not freed as a leak.
    atexit.register(lambda: (gc.unfreeze if "triton" in sys.modules else gc.freeze)())
    show_log()
    try:
        group.main(standalone_mode=False)
    except click.ClickException as error:
        error.show()
        sys.exit(2)
    except click.Abort:
        click.echo("egosplat: interrupted", err=True)
        sys.exit(130)
    except Exception as error:
        if (message := user_message(error)) is None:
            raise
        click.echo(f"egosplat: {message}", err=True)
        sys.exit(2)


def _open_closed_streams() -> None:
    """Open standard streams that the caller closed, as some schedulers do: to nowhere."""
    # The next opened file would take the free number, and a library's warning would be written into it.
    while (handle := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(handle)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115

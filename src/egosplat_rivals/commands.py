"""The command line ``egosplat-rivals``: tables, speed against accuracy, and methods side by side. The workflow calls it."""

from pathlib import Path

import click

from egosplat.cli.commands import run_commands
from egosplat.cli.flags import ARTIFACT, OVERWRITE
from egosplat.files import check_output


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
def rivals() -> None:
    """Compare EgoSplat with other methods, and presets with each other. The workflow calls these commands."""


def main() -> None:
    """Run the command line ``egosplat-rivals``."""
    run_commands(rivals)


@rivals.command(short_help="Write the scores of several scenes as the paper's tables.")
@click.argument("metrics", nargs=-1, type=ARTIFACT)
@click.option("--output", type=ARTIFACT, required=True, help="Output folder of the tables.")
@click.option(
    "--picture", "pictures", multiple=True, type=ARTIFACT, help="Figure on the page. May be repeated."
)
def tables(metrics: tuple[Path, ...], output: Path, pictures: tuple[Path, ...]) -> None:
    """Write METRICS, metrics.json of several scenes, as the paper's tables, next to its printed numbers."""
    from egosplat_rivals.tables.stage import run

    run(metrics, output, pictures=pictures)


@rivals.command(short_help="Compare cost and accuracy of variants.")
@click.argument("metrics", nargs=-1, required=True, type=ARTIFACT)
@click.option("--output", type=ARTIFACT, required=True, help="Output folder of the page.")
def tradeoff(metrics: tuple[Path, ...], output: Path) -> None:
    """Compare cost and accuracy of variants: METRICS are metrics.json of one or more scenes and their variants."""
    from egosplat_rivals.tradeoff.stage import run

    run(metrics, output)


@rivals.command(short_help="Draw the answers of several methods side by side.")
@click.argument("metrics", nargs=-1, required=True, type=ARTIFACT)
@click.option("--title", required=True, help="Name of the scene.")
@click.option("--output", type=ARTIFACT, required=True, help="Output picture, .png.")
@click.option("--overwrite", **OVERWRITE)
def methods_sheet(metrics: tuple[Path, ...], title: str, output: Path, overwrite: bool) -> None:
    """Draw answers of methods side by side: METRICS are metrics.json of one scene's variants."""
    from egosplat_rivals.methods_sheet import run

    check_output(output, "methods.png", overwrite=overwrite)
    run(metrics, output, title)

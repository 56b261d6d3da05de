"""Measure how time, memory and disk of each stage grow with frames, pixels, instances and Gaussians.

    python -m benchmarks.growth measure benchmarks/growth/growth.json
    python -m benchmarks.growth scene benchmarks/growth/growth.json results/adt/scene2 --recorded-side 704
    python -m benchmarks.growth scene benchmarks/growth/growth.json results/adt/scene1 --recorded-side 704 --held-out
    python -m benchmarks.growth report benchmarks/growth/growth.json > docs/scale.md
    python -m benchmarks.growth coefficients benchmarks/growth/growth.json > src/egosplat/cost_model/coefficients.json

The pipeline runs on small synthetic apartments, one factor changed at a time. Laws are fitted to the costs in each
artifact's provenance, and extrapolated. ``measure`` skips points that the file already has. ``scene`` adds a finished
scene of full size, to the fit or as a check of it.
"""

import json
from dataclasses import fields
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from benchmarks.common import output_of
from benchmarks.growth import scene, store
from benchmarks.growth.assumptions import Assumptions
from benchmarks.growth.coefficients import coefficients
from benchmarks.growth.design import POINTS, STAGES, Point
from benchmarks.growth.page import page
from benchmarks.growth.readings import Run, read_runs
from egosplat.artifacts import usage
from egosplat.progress import log


@click.group(help=__doc__)
def main() -> None:
    """Measuring takes minutes; the page and the coefficients are written from the file in a second."""


@main.command()
@click.argument("results", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--work", type=click.Path(path_type=Path), help="Where the pipeline runs; a temporary folder.")
@click.option("--most", default=len(POINTS), show_default=True, help="Points that are measured in this call.")
def measure(results: Path, work: Path | None, most: int) -> None:
    """Measure the points that RESULTS lacks, one job at a time on one thread."""
    measured = store.load(results)
    measured.machine = usage.machine()
    left = [point for point in POINTS if point.name not in measured.points][:most]
    with TemporaryDirectory() as folder:
        place = work or Path(folder)
        scene.prepare(place)
        for point in left:
            log(f"{point.factor}: {point.value}")
            measured.points[point.name] = _measured(place, point)
            store.save(results, measured)
    if not measured.published:
        log("the paper's models")
        measured.published = _published()
        store.save(results, measured)


def _measured(place: Path, point: Point) -> list[Run]:
    scene.make(place, point)
    runs = read_runs(
        place / scene.RESULTS / point.scene,
        scene.own_folder(place, point),
        point.name,
        scene.recorded_side(point),
    )
    # Stages that do not depend on the factor are shared with the center, and are not measured again.
    return [run for run in runs if run.stage in point.stages]


def _published() -> dict[str, float]:
    """Measure the published models in a separate process, on one thread."""
    return json.loads(output_of("benchmarks.growth.published", OMP_NUM_THREADS="1"))


@main.command("scene")
@click.argument("results", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--recorded-side", required=True, type=int, help="Of the recording's pictures [px].")
@click.option("--held-out", is_flag=True, help="Fit no law to it, but check the laws by it.")
def add_scene(results: Path, folder: Path, recorded_side: int, held_out: bool) -> None:
    """Add the finished scene in FOLDER to RESULTS."""
    name = "/".join(folder.resolve().parts[-2:])
    measured = store.load(results)
    kind = measured.checks if held_out else measured.scenes
    kind[name] = [run for run in read_runs(folder, folder, name, recorded_side) if run.stage in STAGES]
    store.save(results, measured)


def _assumptions(command: click.Command) -> click.Command:
    """Add an option for each assumption."""
    for one in reversed(fields(Assumptions)):
        option = click.option(
            f"--{one.name.replace('_', '-')}",
            type=type(one.default),
            default=one.default,
            show_default=True,
            help=one.metadata["about"],
        )
        command = option(command)
    return command


@main.command()
@click.argument("results", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@_assumptions
def report(results: Path, **assumed: float) -> None:
    """Print the page docs/scale.md from RESULTS; each assumption is an option."""
    click.echo(page(store.load(results), Assumptions(**assumed)), nl=False)


@main.command("coefficients")
@click.argument("results", type=click.Path(exists=True, dir_okay=False, path_type=Path))
def print_coefficients(results: Path) -> None:
    """Print the table of the cost model from RESULTS."""
    click.echo(json.dumps(coefficients(store.load(results)), indent=1))


if __name__ == "__main__":
    main()

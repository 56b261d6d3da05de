"""How time, memory and disk of each stage grow with frames, pixels, instances and Gaussians.

    python benchmarks/growth.py measure benchmarks/growth.json
    python benchmarks/growth.py check benchmarks/growth.json results/adt/scene1 --recorded-side 704
    python benchmarks/growth.py report benchmarks/growth.json > docs/scale.md

The pipeline is run on small synthetic apartments, one factor changed at a time; laws are fitted to what each artifact says
of its making, and extrapolated. What ``measure`` finds in the file is not measured again. ``check`` adds a finished scene
that no law is fitted to, to hold the laws against.
"""

import json
import os
import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from tempfile import TemporaryDirectory

import click
from growth_bench import scene, store
from growth_bench.assumptions import Assumptions
from growth_bench.design import POINTS, Point
from growth_bench.page import page
from growth_bench.readings import Run, read_runs

from egosplat import costs
from egosplat.progress import log

BENCHMARKS = Path(__file__).resolve().parent


@click.group(help=__doc__)
def main() -> None:
    """Measure and report are apart: the page can be made anew in a second."""


@main.command()
@click.argument("results", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--work", type=click.Path(path_type=Path), help="Where the pipeline runs; a temporary folder.")
@click.option("--most", default=len(POINTS), show_default=True, help="Points that are measured in this call.")
def measure(results: Path, work: Path | None, most: int) -> None:
    """Measure what RESULTS lacks, one job at a time on one thread."""
    measured = store.load(results)
    measured.machine = costs.machine()
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
    # Stages that only came along for a later one, as they do not depend on the factor, say nothing more of it.
    return [run for run in runs if run.stage in point.stages]


def _published() -> dict[str, float]:
    """In a process of its own, on one thread."""
    command = [sys.executable, "-m", "growth_bench.published"]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, check=True, cwd=BENCHMARKS, env=environment, stdout=subprocess.PIPE)
    return json.loads(done.stdout)


@main.command()
@click.argument("results", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--recorded-side", required=True, type=int, help="Of the recording's pictures [px].")
def check(results: Path, folder: Path, recorded_side: int) -> None:
    """Add the finished scene in FOLDER to RESULTS, to hold the laws against."""
    name = "/".join(folder.resolve().parts[-2:])
    measured = store.load(results)
    measured.checks[name] = read_runs(folder, folder, name, recorded_side)
    store.save(results, measured)


def _assumptions(command: click.Command) -> click.Command:
    """An option for each assumption."""
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
    """Print the page of RESULTS; what is assumed for the extrapolation can be changed."""
    click.echo(page(store.load(results), Assumptions(**assumed)), nl=False)


if __name__ == "__main__":
    main()

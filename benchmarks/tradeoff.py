"""The measured trade of speed against accuracy of a scene as a table, from its ``tradeoff.json``.

    snakemake --cores 1 --max-threads 1 --configfile benchmarks/tradeoff/scene1.yaml -- \
        results/adt/scene1/tradeoff/tradeoff.html
    python benchmarks/tradeoff.py results/adt/scene1

Intervals of the means are over seeds; the last two columns compare answers to the same queries with those of the scene as
it is configured, of its own seed, with intervals over categories.
"""

import sys
from pathlib import Path
from typing import Any

import click
from scores_bench.comparing import METHOD, accuracy_difference, chance, iou_difference, paired

from egosplat.errors import UserError
from egosplat.files import read_json
from egosplat.tables.scored_scenes import ScoredScene, read_scored_scene
from egosplat.tradeoff.measures import MEASURES, Measure

HEADINGS = [
    "point",
    *(f"{one.heading} [{one.unit}]" for one in MEASURES),
    "accuracy, same queries",
    "mIoU, same queries",
]


def cell(measure: Measure, found: dict[str, Any] | None) -> str:
    """A mean with its interval, in words."""
    if found is None:
        return "-"
    bounds = (
        "" if found["low"] is None else f" ({measure.told(found['low'])} to {measure.told(found['high'])})"
    )
    return measure.told(found["mean"]) + bounds


def row(point: dict[str, Any], folder: Path, scene: ScoredScene) -> str:
    """A point's line; the name is bold on the front of time and accuracy."""
    name = f"**{point['label']}**" if point["front"] else point["label"]
    compared = ["", ""]
    if point["variant"]:
        own = read_scored_scene(folder / "variants" / point["variant"] / "metrics.json")
        pair = [paired(own, scene)]
        compared = [accuracy_difference(pair), iou_difference(pair)]
    measured = [cell(one, point["measures"][one.name]) for one in MEASURES]
    return f"| {' | '.join([name, *measured, *compared])} |"


@click.command(help=__doc__)
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
def main(folder: Path) -> None:
    """Print a table."""
    found, scene = (
        read_json(folder / "tradeoff/tradeoff.json"),
        read_scored_scene(folder / "metrics.json"),
    )
    intervals = f", with {100 * found['confidence']:g} % intervals"
    runs = f"Means of {found['seeds']} runs{intervals}" if found["seeds"] > 1 else "One run each"
    click.echo(
        f"{found['scene']}: {found['about']}; {'; '.join(found['machines'])}. {runs}; bold: on the front of time and "
        f"accuracy. Intervals of means are over seeds. {chance([scene])} The same queries: {METHOD}\n"
    )
    click.echo(f"| {' | '.join(HEADINGS)} |\n| --- |{' ---: |' * (len(HEADINGS) - 1)}")
    for point in found["points"]:
        click.echo(row(point, folder, scene))


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"tradeoff.py: {error}")

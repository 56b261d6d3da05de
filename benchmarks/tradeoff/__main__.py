"""The measured trade of speed against accuracy of a scene, from its ``tradeoff.json``, as a table.

    snakemake --cores 1 --max-threads 1 --configfile benchmarks/tradeoff/scene1.yaml -- \
        results/adt/scene1/tradeoff/tradeoff.html
    python -m benchmarks.tradeoff results/adt/scene1

Intervals of the means are over seeds. The last two columns compare answers to the same queries with those of the scene's own
configuration and seed, with intervals over categories.
"""

from pathlib import Path
from typing import Any

import click

from benchmarks.common import command, markdown
from benchmarks.scores import METHOD, accuracy_difference, chance, iou_difference, paired
from egosplat.files import read_json
from egosplat.tables.scored_scenes import ScoredScene, read_scored_scene
from egosplat.tradeoff.measured import MEASURES, Measure

HEADINGS = (
    "point",
    *(f"{one.heading} [{one.unit}]" for one in MEASURES),
    "accuracy, same queries",
    "mIoU, same queries",
)


def cell(measure: Measure, found: dict[str, Any] | None) -> str:
    """A mean with its interval."""
    if found is None:
        return "-"
    if found["low"] is None:
        return measure.text(found["mean"])
    return f"{measure.text(found['mean'])} ({measure.text(found['low'])} to {measure.text(found['high'])})"


def row(point: dict[str, Any], folder: Path, scene: ScoredScene) -> list[str]:
    """A point's row; its name is bold on the Pareto front of time and accuracy."""
    name = f"**{point['label']}**" if point["front"] else point["label"]
    compared = ["", ""]
    if point["variant"]:
        own = read_scored_scene(folder / "variants" / point["variant"] / "metrics.json")
        compared = [accuracy_difference([paired(own, scene)]), iou_difference([paired(own, scene)])]
    return [name, *(cell(one, point["measures"][one.name]) for one in MEASURES), *compared]


@command(__doc__)
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
def main(folder: Path) -> None:
    """Print the table."""
    found = read_json(folder / "tradeoff/tradeoff.json")
    scene = read_scored_scene(folder / "metrics.json")
    intervals = f", with {100 * found['confidence']:g} % intervals"
    runs = f"Means of {found['seeds']} runs{intervals}" if found["seeds"] > 1 else "One run each"
    click.echo(
        f"{found['scene']}: {found['about']}; {'; '.join(found['machines'])}. {runs}. Bold: on the Pareto front of time and "
        f"accuracy. Intervals of means are over seeds. {chance([scene])} The same queries: {METHOD}\n"
    )
    click.echo(markdown(HEADINGS, [row(point, folder, scene) for point in found["points"]]))


if __name__ == "__main__":
    main()

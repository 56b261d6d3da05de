"""The measured trade of speed against accuracy of scenes and their variants, as a table of means.

    snakemake --cores 1 --max-threads 1 --configfile benchmarks/tradeoff/presets.yaml -- \
        results/adt/scene{1..5}/tradeoff/tradeoff.html
    python -m benchmarks.tradeoff results/adt/scene{1..5}

Costs are means over scenes. The last two columns compare answers to the same queries with those of the scenes' own configuration.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import click
import pandas as pd

from benchmarks.common import command, markdown, scene_folders
from benchmarks.rows import collect_page, rows_option
from benchmarks.scores import METHOD, accuracy_difference, chance, format_score, iou_difference, pair_answers
from egosplat.pipeline.home import title_of
from egosplat_rivals.scored_scenes import ScoredScene
from egosplat_rivals.tables.paper_tables import average
from egosplat_rivals.tradeoff.measured import (
    COSTS,
    GAINS,
    SCENE,
    find_front,
    list_numbers,
    mean_points,
    read_runs,
)

HEADINGS = (
    "point",
    *(one.label for one in COSTS.values()),
    *(one.label for one in GAINS.values()),
    "accuracy, same queries",
    "mIoU, same queries",
)


def row(point: pd.Series, scored: Mapping[str, ScoredScene], scenes: Mapping[str, ScoredScene]) -> list[str]:
    """A point's row, but for its name."""
    pairs = [pair_answers(scored[name], scene) for name, scene in scenes.items()]
    own = scored == scenes
    return [
        *(one.text(point[name]) for name, one in COSTS.items()),
        *(format_score(average(scored, score, "all")) for score in ("accuracy", "mean_iou")),
        GAINS["psnr"].text(point.psnr),
        *(["", ""] if own else [accuracy_difference(pairs), iou_difference(pairs)]),
    ]


@command(__doc__)
@scene_folders
@rows_option
def main(folders: Sequence[Path], rows: Path | None) -> None:
    """Print the table; points on the Pareto front of time and accuracy are bold."""
    tables = [pd.read_csv(folder / "tradeoff/tradeoff.csv", keep_default_na=False) for folder in folders]
    shared = [name for name in tables[0].point.unique() if all(name in set(own.point) for own in tables)]
    variants = {name: None if name == SCENE else name for name in shared}
    places = {name: f"variants/{name}/metrics.json" if name != SCENE else "metrics.json" for name in shared}
    runs = {name: read_runs([folder / place for folder in folders]) for name, place in places.items()}
    scored = {name: dict(zip(map(title_of, folders), own, strict=True)) for name, own in runs.items()}
    points = mean_points(list_numbers([run for own in runs.values() for run in own]))
    collect_page("tradeoff", folders, variants, rows)
    records = [
        record for own in runs.values() for run in own for record in run.document["artifacts"].values()
    ]
    machines = sorted({record["machine"] for record in records if "machine" in record})
    click.echo(
        f"{', '.join(map(title_of, folders))}: {tables[0].about[0]}; {'; '.join(machines)}. Bold: on the Pareto front of "
        f"time and accuracy. {METHOD} {chance(runs[SCENE])}\n"
    )
    front = find_front(points)
    lines = [
        [f"**{name}**" if name in front else name, *row(points.loc[name], scored[name], scored[SCENE])]
        for name in shared
    ]
    click.echo(markdown(HEADINGS, lines))


if __name__ == "__main__":
    main()

"""The measured trade of speed against accuracy of scenes, from their ``tradeoff.json``, as a table of means.

    snakemake --cores 1 --max-threads 1 --configfile benchmarks/tradeoff/presets.yaml -- \
        results/adt/scene{1..5}/tradeoff/tradeoff.html
    python -m benchmarks.tradeoff results/adt/scene{1..5}

Costs are means over scenes. The last two columns compare answers to the same queries with those of the scenes' own configuration.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from benchmarks.common import command, markdown, scene_folders
from benchmarks.rows import collect_page, rows_option
from benchmarks.scores import METHOD, accuracy_difference, chance, format_score, iou_difference, pair_answers
from egosplat.evaluation.scored_scenes import ScoredScene, read_scored_scene
from egosplat.files import read_json
from egosplat.pipeline.scene_folder import title_of
from egosplat_rivals.tables.paper_tables import average
from egosplat_rivals.tradeoff.measured import COSTS, PSNR, Measure
from egosplat_rivals.tradeoff.scenes import mean_points

HEADINGS = (
    "point",
    *(f"{one.heading} [{one.unit}]" for one in COSTS),
    "accuracy [%]",
    "mIoU [%]",
    f"{PSNR.heading} [{PSNR.unit}]",
    "accuracy, same queries",
    "mIoU, same queries",
)


def mean(point: Mapping[str, Any], measure: Measure) -> str:
    """The mean of a measure."""
    found = point["measures"][measure.name]
    return measure.text(found and found["mean"])


def row(point: Mapping[str, Any], scenes: Mapping[Path, ScoredScene]) -> list[str]:
    """A point's row; its name is bold on the Pareto front of time and accuracy."""
    scored, compared = scenes, ["", ""]
    if point["variant"]:
        scored = {
            folder: read_scored_scene(folder / "variants" / point["variant"] / "metrics.json")
            for folder in scenes
        }
        pairs = [pair_answers(scored[folder], scene) for folder, scene in scenes.items()]
        compared = [accuracy_difference(pairs), iou_difference(pairs)]
    named = {title_of(folder): one for folder, one in scored.items()}
    return [
        f"**{point['label']}**" if point["front"] else point["label"],
        *(mean(point, one) for one in COSTS),
        *(format_score(average(named, score, "all")) for score in ("accuracy", "mean_iou")),
        mean(point, PSNR),
        *compared,
    ]


@command(__doc__)
@scene_folders
@rows_option
def main(folders: Sequence[Path], rows: Path | None) -> None:
    """Print the table."""
    documents = [read_json(folder / "tradeoff/tradeoff.json") for folder in folders]
    points = mean_points(documents)
    collect_page("tradeoff", folders, {point["label"]: point["variant"] for point in points}, rows)
    scenes = {folder: read_scored_scene(folder / "metrics.json") for folder in folders}
    machines = sorted({name for document in documents for name in document["machines"]})
    click.echo(
        f"{', '.join(map(title_of, folders))}: {documents[0]['about']}; {'; '.join(machines)}. Bold: on the Pareto front of "
        f"time and accuracy. {METHOD} {chance([*scenes.values()])}\n"
    )
    click.echo(markdown(HEADINGS, [row(point, scenes) for point in points]))


if __name__ == "__main__":
    main()

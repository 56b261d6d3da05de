"""Scores of scenes and of their ablation variants, and paired differences between variants.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/{,variants/{baseline,no_masks,network_masks}/}metrics.json
    python -m benchmarks.ablation results/adt/scene{1,2,3,4,5} > benchmarks/ablation/README.md

Apartments kept for reporting only get tables of their own. Masking by variant: `baseline` and `aggregation` mask nothing,
`initial` masks what the network predicts, `full` masks the instances that refine the prediction.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import click
import numpy as np

from benchmarks.common import command, markdown, scene_folders
from benchmarks.scores import (
    METHOD,
    SCORES,
    accuracy_difference,
    format_score,
    iou_difference,
    pair_answers,
    psnr,
    queries_of,
)
from egosplat.evaluation.scored_scenes import CHANCE, Cell, ScoredScene, check_protocol, read_scored_scene
from egosplat.pipeline.scene_folder import title_of
from egosplat.report.tables.paper_tables import average, average_chance
from egosplat.report.tables.table import number

# Folder of each variant inside the scene's folder.
VARIANTS = {
    "baseline": "variants/baseline/",
    "no_masks": "variants/no_masks/",
    "network_masks": "variants/network_masks/",
    "full": "",
}

# Pairs of variants whose answers to the same queries are compared.
COMPARED = (
    ("no_masks", "baseline"),
    ("network_masks", "no_masks"),
    ("full", "no_masks"),
    ("full", "baseline"),
)

HEADINGS = (
    "scene",
    "variant",
    "queries",
    "categories",
    "accuracy",
    *(f"accuracy of {name}" for name in CHANCE.values()),
    "static",
    "dynamic",
    "mIoU",
    "PSNR, all",
    "PSNR, static",
)

# Scored scenes by scene name, then variant.
Scenes = Mapping[str, Mapping[str, ScoredScene]]


def _row(
    name: str, variant: str, cells: Sequence[Cell], chance: Sequence[Cell], psnrs: Sequence[float]
) -> list[str]:
    """A table row from cells of ``SCORES``, cells of ``CHANCE`` and PSNR over all and static pixels."""
    accuracy, *others = map(format_score, cells)
    counts = [str(cells[0].queries), str(cells[0].categories)]
    chances = [number(cell.percent) for cell in chance]
    return [name, variant, *counts, accuracy, *chances, *others, *(f"{value:.2f}" for value in psnrs)]


def scene_row(name: str, variant: str, scene: ScoredScene) -> list[str]:
    """The row of one variant of one scene."""
    cells = [scene.cell(*score) for score in SCORES]
    chance = [scene.chance(answerer, "all") for answerer in CHANCE]
    return _row(name, variant, cells, chance, [psnr(scene, "all"), psnr(scene, "static")])


def mean_row(variant: str, scenes: Mapping[str, ScoredScene]) -> list[str]:
    """The row of a variant's means over scenes."""
    cells = [average(scenes, *score) for score in SCORES]
    chance = [average_chance(scenes, answerer, "all") for answerer in CHANCE]
    means = [float(np.mean([psnr(one, pixels) for one in scenes.values()])) for pixels in ("all", "static")]
    return _row(f"mean of {len(scenes)}", variant, cells, chance, means)


def table(scenes: Scenes) -> str:
    """Rows by scene and variant, then the means over scenes."""
    rows = [scene_row(name, *item) for name, variants in scenes.items() for item in variants.items()]
    if len(scenes) > 1:
        rows += [mean_row(one, {name: own[one] for name, own in scenes.items()}) for one in VARIANTS]
    return markdown(HEADINGS, rows, words=2)


def differences(scenes: Scenes) -> str:
    """Differences between variants over the queries of all scenes."""
    columns = ("compared", "queries", "found by the first only", "by the second only", "accuracy", "mIoU")
    rows = []
    for one, other in COMPARED:
        pairs = [pair_answers(variants[one], variants[other]) for variants in scenes.values()]
        only = [sum(pair.gained for pair in pairs), sum(pair.lost for pair in pairs)]
        measured = [accuracy_difference(pairs), iou_difference(pairs)]
        rows.append([f"{one} against {other}", queries_of(pairs), *only, *measured])
    return markdown(columns, rows)


def read(folders: Sequence[Path]) -> Scenes:
    """Read the scores of scenes and variants.

    Raises:
        UserError: a file is missing, or scenes were queried or scored by different settings.
    """
    scenes = {
        title_of(folder): {
            variant: read_scored_scene(folder / below / "metrics.json") for variant, below in VARIANTS.items()
        }
        for folder in folders
    }
    check_protocol([one for variants in scenes.values() for one in variants.values()])
    return scenes


def page(scenes: Scenes) -> str:
    """Both tables with an introduction."""
    every = [one for variants in scenes.values() for one in variants.values()]
    small = all(model.small for one in every for model in one.models)
    about = (
        f"Origin {', '.join(sorted({one.origin for one in every}))}, "
        f"{'the small checkpoints' if small else 'checkpoints as in metrics.json'}; accuracy and mIoU in percent, PSNR in dB. "
        f"{METHOD} Scenes: {len(scenes)}."
    )
    compared = (
        "Differences between two variants on the same queries, in percentage points, means over scenes."
    )
    return "\n\n".join([about, table(scenes), compared, differences(scenes)])


@command(__doc__)
@scene_folders
def main(folders: tuple[Path, ...]) -> None:
    """Print the tables."""
    scenes = read(folders)
    untouched = {name: own for name, own in scenes.items() if own["full"].untouched}
    tuning = {name: own for name, own in scenes.items() if name not in untouched}
    click.echo("# Ablation\n\nScores without each component: `python -m benchmarks.ablation`.\n")
    if tuning:
        click.echo(page(tuning))
    if untouched:
        click.echo("\n## Untouched apartments\n\nNo default, threshold or design was chosen on these.\n")
        click.echo(page(untouched))


if __name__ == "__main__":
    main()

"""What each component is worth: the scores of scenes and their variants side by side.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/{,variants/{baseline,aggregation,initial}/}metrics.json
    python benchmarks/ablation.py results/adt/scene{1,2,3,4,5} > benchmarks/ablation.md

Untouched apartments, by which nothing is chosen, have a table of their own below. What moves: `baseline` and `aggregation`
mask nothing, `initial` what the network says, `full` the instances that it is refined by.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import click
import numpy as np
from scores_bench.comparing import (
    METHOD,
    SCORES,
    Paired,
    accuracy_difference,
    iou_difference,
    paired,
    psnr,
    queries_of,
    told,
)

from egosplat.errors import UserError
from egosplat.tables.averages import average, average_chance
from egosplat.tables.scored_scenes import CHANCE, ScoredScene, check_protocol, read_scored_scene
from egosplat.tables.table import Cell, number

VARIANTS = {
    "baseline": "variants/baseline/",
    "aggregation": "variants/aggregation/",
    "initial": "variants/initial/",
    "full": "",
}
"""Folder of each."""

COMPARED = (
    ("aggregation", "baseline"),
    ("initial", "aggregation"),
    ("full", "aggregation"),
    ("full", "baseline"),
)
"""Variants whose answers to the same queries are compared."""

HEADINGS = (
    "scene",
    "variant",
    "queries",
    "categories",
    "accuracy",
    *(f"accuracy of {name}" for name in CHANCE.values()),
    "of what stays",
    "of what can move",
    "mIoU",
    "PSNR, all",
    "PSNR, static",
)
PAIRED = (
    "| one against the other | queries | found by one alone | by the other alone | accuracy | mIoU |\n| --- |"
    + (" ---: |" * 5)
)

Scenes = Mapping[str, Mapping[str, ScoredScene]]
"""By name of the scene, then variant."""


def row(
    name: str, variant: str, cells: Sequence[Cell], chance: Sequence[Cell], psnrs: Sequence[float]
) -> str:
    """One line of the table; ``cells`` are of ``SCORES``, ``chance`` of ``CHANCE``, ``psnrs`` of all and static pixels."""
    accuracy, *others = map(told, cells)
    counts = [str(cells[0].queries), str(cells[0].categories)]
    chances = [number(cell.percent) for cell in chance]
    line = [name, variant, *counts, accuracy, *chances, *others, *(f"{value:.2f}" for value in psnrs)]
    return f"| {' | '.join(line)} |"


def scene_row(name: str, variant: str, scene: ScoredScene) -> str:
    """A scene's line."""
    cells = [scene.cell(*score) for score in SCORES]
    chance = [scene.chance(answerer, "all") for answerer in CHANCE]
    return row(name, variant, cells, chance, [psnr(scene, "all"), psnr(scene, "static")])


def mean_row(variant: str, scenes: Mapping[str, ScoredScene]) -> str:
    """The line of the means over scenes."""
    cells = [average(scenes, *score) for score in SCORES]
    chance = [average_chance(scenes, answerer, "all") for answerer in CHANCE]
    means = [float(np.mean([psnr(one, pixels) for one in scenes.values()])) for pixels in ("all", "static")]
    return row(f"mean of {len(scenes)}", variant, cells, chance, means)


def table(scenes: Scenes) -> str:
    """Rows by scene and variant, then the means over scenes."""
    lines = [f"| {' | '.join(HEADINGS)} |", f"| --- | --- |{' ---: |' * (len(HEADINGS) - 2)}"]
    lines += [
        scene_row(name, variant, one)
        for name, variants in scenes.items()
        for variant, one in variants.items()
    ]
    if len(scenes) > 1:
        for variant in VARIANTS:
            lines.append(mean_row(variant, {name: own[variant] for name, own in scenes.items()}))
    return "\n".join(lines)


def differences(scenes: Scenes) -> str:
    """Differences between variants over the queries of all scenes."""
    lines = [PAIRED]
    for one, other in COMPARED:
        pairs = [paired(variants[one], variants[other]) for variants in scenes.values()]
        cells = [f"{one} against {other}", str(queries_of(pairs)), *_alone(pairs)]
        lines.append(f"| {' | '.join([*cells, accuracy_difference(pairs), iou_difference(pairs)])} |")
    return "\n".join(lines)


def _alone(pairs: Sequence[Paired]) -> list[str]:
    return [str(sum(pair.gained for pair in pairs)), str(sum(pair.lost for pair in pairs))]


def read(folders: Sequence[Path]) -> Scenes:
    """The scores of scenes and variants that were asked and scored alike."""
    scenes = {
        f"{folder.parent.name}/{folder.name}": {
            variant: read_scored_scene(folder / below / "metrics.json") for variant, below in VARIANTS.items()
        }
        for folder in folders
    }
    check_protocol([one for variants in scenes.values() for one in variants.values()])
    return scenes


def page(scenes: Scenes) -> str:
    """Both tables of scenes, with what they are."""
    every = [one for variants in scenes.values() for one in variants.values()]
    small = all(model.small for one in every for model in one.models)
    about = (
        f"Origin {', '.join(sorted({one.origin for one in every}))}, "
        f"{'the small checkpoints' if small else 'checkpoints as metrics.json says'}; accuracy and mIoU in percent, PSNR in dB. "
        f"{METHOD} Scenes: {len(scenes)}."
    )
    compared = (
        "The same queries, answered by two variants; differences in percentage points, means over scenes."
    )
    return "\n\n".join([about, table(scenes), compared, differences(scenes)])


@click.command(help=__doc__)
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
def main(folders: tuple[Path, ...]) -> None:
    """Print the tables."""
    scenes = read(folders)
    untouched = {name: own for name, own in scenes.items() if own["full"].untouched}
    chosen_by = {name: own for name, own in scenes.items() if name not in untouched}
    click.echo("Each component left out: `benchmarks/ablation.py`.\n")
    if chosen_by:
        click.echo(page(chosen_by))
    if untouched:
        click.echo("\n## Untouched apartments\n\nNo default, threshold or design was chosen by these.\n")
        click.echo(page(untouched))


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"ablation.py: {error}")

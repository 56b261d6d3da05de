"""Processor time and scores of variants, paired with their scenes over the same queries.

    snakemake --cores 2 -- \
        results/adt/scene{2,3,4,5}/{,variants/{no_masks,baseline}/}metrics.json
    python -m benchmarks.variants --variant no_masks --variant baseline results/adt/scene{2,3,4,5}
"""

from pathlib import Path

import click

from benchmarks.common import command, markdown, scene_folders
from benchmarks.scores import (
    METHOD,
    Paired,
    accuracy_difference,
    chance,
    iou_difference,
    pair_answers,
    queries_of,
    seconds,
)
from egosplat.evaluation.scored_scenes import ScoredScene, check_protocol, read_scored_scene
from egosplat.pipeline.scene_folder import title_of

COLUMNS = (
    "scene",
    "variant",
    "queries",
    "CPU-s, scene",
    "variant",
    "accuracy, scene",
    "variant",
    "difference",
    "mIoU, scene",
    "variant",
    "difference",
)


def percent(scene: ScoredScene, score: str) -> str:
    """A score over all queries [%]."""
    return f"{100 * scene.document['scores']['all'][score]:.1f}"


def row(folder: Path, variant: str, scene: ScoredScene) -> tuple[list[str], Paired]:
    """The row of one variant of one scene, and its paired differences."""
    own = read_scored_scene(folder / "variants" / variant / "metrics.json")
    check_protocol([scene, own])
    pair = pair_answers(own, scene)
    cells = [title_of(folder), variant, str(queries_of([pair]))]
    cells += [f"{seconds(scene):.0f}", f"{seconds(own):.0f}"]
    cells += [percent(scene, "accuracy"), percent(own, "accuracy"), accuracy_difference([pair])]
    cells += [percent(scene, "mean_iou"), percent(own, "mean_iou"), iou_difference([pair])]
    return cells, pair


@command(__doc__)
@scene_folders
@click.option("--variant", "variants", multiple=True, required=True)
def main(folders: tuple[Path, ...], variants: tuple[str, ...]) -> None:
    """Print the table."""
    scenes = {folder: read_scored_scene(folder / "metrics.json") for folder in folders}
    rows: list[list[str]] = []
    for variant in variants:
        measured = [row(folder, variant, scene) for folder, scene in scenes.items()]
        pairs = [pair for _, pair in measured]
        rows += [cells for cells, _ in measured]
        both = ["", "", accuracy_difference(pairs), "", "", iou_difference(pairs)]
        rows.append(["all", variant, str(queries_of(pairs)), "", "", *both])
    click.echo(f"{METHOD} {chance(list(scenes.values()))}\n\n{markdown(COLUMNS, rows, words=2)}")


if __name__ == "__main__":
    main()

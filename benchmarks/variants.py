"""Variants against their scenes: what they cost, and their answers to the same queries.

    snakemake --cores 2 --configfile benchmarks/tradeoff/codes.yaml -- \
        results/adt/scene{2,3,4,5}/{,variants/{ae16,ae8,lin32}/}metrics.json
    python benchmarks/variants.py --variant ae16 --variant ae8 --variant lin32 results/adt/scene{2,3,4,5}
"""

import sys
from pathlib import Path

import click
from scores_bench.comparing import (
    METHOD,
    accuracy_difference,
    chance,
    iou_difference,
    paired,
    queries_of,
    seconds,
)

from egosplat.errors import UserError
from egosplat.tables.scored_scenes import ScoredScene, check_protocol, read_scored_scene

HEADER = (
    "| scene | variant | queries | CPU-s, the scene's | the variant's | accuracy, the scene's | the variant's | difference "
    "| mIoU, the scene's | the variant's | difference |\n| --- | --- |" + " ---: |" * 9
)


def percent(scene: ScoredScene, score: str) -> str:
    """A score of all queries."""
    return f"{100 * scene.document['scores']['all'][score]:.1f}"


@click.command(help=__doc__)
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("--variant", "variants", multiple=True, required=True)
def main(folders: tuple[Path, ...], variants: tuple[str, ...]) -> None:
    """Print the table."""
    scenes = [read_scored_scene(folder / "metrics.json") for folder in folders]
    click.echo(f"{METHOD} {chance(scenes)}\n\n{HEADER}")
    for variant in variants:
        every = []
        for folder in folders:
            scene, own = (
                read_scored_scene(folder / below / "metrics.json") for below in ("", f"variants/{variant}")
            )
            check_protocol([scene, own])
            pair = paired(own, scene)
            every.append(pair)
            cells = [f"{folder.parent.name}/{folder.name}", variant, str(queries_of([pair]))]
            cells += [f"{seconds(scene):.0f}", f"{seconds(own):.0f}"]
            cells += [percent(scene, "accuracy"), percent(own, "accuracy"), accuracy_difference([pair])]
            cells += [percent(scene, "mean_iou"), percent(own, "mean_iou"), iou_difference([pair])]
            click.echo(f"| {' | '.join(cells)} |")
        differences = f"{accuracy_difference(every)} | | | {iou_difference(every)}"
        click.echo(f"| all | {variant} | {queries_of(every)} | | | | | {differences} |")


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"variants.py: {error}")

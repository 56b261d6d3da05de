"""What each component is worth: the scores of scenes and their variants side by side.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/{,variants/{baseline,aggregation,initial}/}metrics.json
    python benchmarks/ablation.py results/adt/scene* > benchmarks/ablation.md

Accuracy and mIoU in percent with 95 % intervals over queries; PSNR of held-out frames in dB. What moves: `baseline` and
`aggregation` mask nothing, `initial` what the network says, `full` the instances that it is refined by.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import click
import numpy as np
from scores_bench.comparing import SCORES, difference, differences, psnr, told

from egosplat.benchmark.averages import average
from egosplat.benchmark.scored_scenes import ScoredScene, check_protocol, read_scored_scene
from egosplat.benchmark.tables import Cell
from egosplat.errors import UserError

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

HEADER = (
    "| scene | variant | queries | accuracy | of what stays | of what can move | mIoU | PSNR, all | PSNR, static |\n"
    "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"
)


def row(name: str, variant: str, cells: Sequence[Cell], psnrs: Sequence[float]) -> str:
    """One line of the table; ``cells`` are of ``SCORES``, ``psnrs`` of all and of static pixels."""
    scores = " | ".join(map(told, cells))
    return f"| {name} | {variant} | {cells[0].queries} | {scores} | {psnrs[0]:.2f} | {psnrs[1]:.2f} |"


def table(scenes: Mapping[str, Mapping[str, ScoredScene]]) -> str:
    """Rows by scene and variant, then the means over scenes."""
    lines = [HEADER]
    for name, variants in scenes.items():
        for variant, one in variants.items():
            cells = [one.cell(*score) for score in SCORES]
            lines.append(row(name, variant, cells, [psnr(one, "all"), psnr(one, "static")]))
    if len(scenes) > 1:
        for variant in VARIANTS:
            own = {name: variants[variant] for name, variants in scenes.items()}
            cells = [average({name: one.cell(*score) for name, one in own.items()}) for score in SCORES]
            means = [
                float(np.mean([psnr(one, pixels) for one in own.values()])) for pixels in ("all", "static")
            ]
            lines.append(row(f"mean of {len(own)}", variant, cells, means))
    return "\n".join(lines)


def paired(scenes: Mapping[str, Mapping[str, ScoredScene]]) -> str:
    """Differences between variants over the queries of all scenes, with intervals."""
    lines = [
        "| one against the other | queries | found by one alone | by the other alone | accuracy | mIoU |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for one, other in COMPARED:
        every = [differences(variants[one], variants[other]) for variants in scenes.values()]
        hits, ious = np.concatenate(every).T
        gained, lost = int((hits > 0).sum()), int((hits < 0).sum())
        by_how_much = f"{difference(hits)} | {difference(ious)}"
        lines.append(f"| {one} against {other} | {len(hits)} | {gained} | {lost} | {by_how_much} |")
    return "\n".join(lines)


@click.command(help=__doc__)
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
def main(folders: tuple[Path, ...]) -> None:
    """Print the table."""
    scenes = {
        f"{folder.parent.name}/{folder.name}": {
            variant: read_scored_scene(folder / below / "metrics.json") for variant, below in VARIANTS.items()
        }
        for folder in folders
    }
    read = [one for variants in scenes.values() for one in variants.values()]
    check_protocol(read)
    origins = ", ".join(sorted({one.origin for one in read}))
    small = all(model.small for one in read for model in one.models)
    click.echo(
        f"Each component left out: `benchmarks/ablation.py`. Origin {origins}, "
        f"{'the small checkpoints' if small else 'checkpoints as metrics.json says'}; accuracy and mIoU in percent, PSNR in dB.\n"
    )
    click.echo(table(scenes))
    click.echo(
        "\nThe same queries, answered by two variants; differences in percentage points, 95 % intervals.\n"
    )
    click.echo(paired(scenes))


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"ablation.py: {error}")

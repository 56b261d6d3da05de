"""Accuracy of small OpenCLIP models on crops of held-out worlds.

    python -m training.render_worlds data/held_out_crops --worlds 20 --held-out --clips 8 --frames 1
    python -m training.cut_crops data/held_out_crops data/crops_held_out --worlds 20 --segments
    python -m benchmarks.small_open_clip data/crops_held_out src/egosplat/models/small_open_clip \
        > benchmarks/small_open_clip/README.md

Prints the scores of one model by kind of crop, then all scores of its masked crops; of several models, the mean
and range.
"""

from pathlib import Path

import click
import numpy as np
import torch
from safetensors.torch import load_file

from benchmarks.common import command, markdown
from training.small_models.clip_evaluation import Exam, Score, table, table_of_kinds, worst
from training.small_models.clip_model import WEIGHTS, build
from training.small_models.crops import KINDS, Crops, read_crops


def examine(folder: Path, crops: Crops) -> dict[str, Exam]:
    """The exams of a model by kind: the same objects masked and as unmasked squares, tiles, hulls of masks of SAM2."""
    model, tokenizer = build(folder)
    model.load_state_dict(load_file(folder / WEIGHTS))
    objects, tiles, segments = (crops.chosen(crops.kind == kind) for kind in range(len(KINDS)))
    shown = {"masked crop": (objects, True), "unmasked square": (objects, False), "tile": (tiles, False)}
    shown |= {"mask of SAM2": (segments, True)} if len(segments) else {}
    return {kind: Exam(model.eval(), tokenizer, *what) for kind, what in shown.items()}


def kinds_table(exams: dict[str, Exam]) -> str:
    """A row for each kind of crop: its scores and the number of crops of things."""
    scores = table_of_kinds(exams)
    names = list(scores["tile"])
    rows = [
        [kind, *(f"{row[name].share:.3f}" for name in names), f"{row[names[0]].count:,}"]
        for kind, row in scores.items()
    ]
    return markdown(["", *names, "crops of objects"], rows)


def scores_table(scores: list[dict[str, Score]]) -> str:
    """A row for each score: its share, or mean and range over several models."""
    rows = []
    for name, first in scores[0].items():
        shares = [one[name].share for one in scores]
        spread = [f"{min(shares):.3f} to {max(shares):.3f}"] if len(scores) > 1 else []
        rows.append([name, f"{np.mean(shares):.3f}", *spread, f"{first.count:,}"])
    return markdown(
        ["", "share", "of"] if len(scores) == 1 else ["", "mean", "lowest to highest", "of"], rows
    )


@command(__doc__)
@click.argument("crops", type=click.Path(exists=True, path_type=Path))
@click.argument("models", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
def main(crops: Path, models: tuple[Path, ...]) -> None:
    """Print the table."""
    torch.set_num_threads(1)
    held_out = read_crops(sorted(crops.glob("*.npz")))
    exams = [examine(folder, held_out) for folder in models]
    worlds = len(set(held_out.world.tolist()))
    click.echo(f"{len(held_out):,} crops of {worlds} held-out worlds; shares of right answers.\n")
    if len(exams) == 1:
        click.echo(f"{kinds_table(exams[0])}\n\nMasked crops:\n")
    masked = [exam["masked crop"] for exam in exams]
    click.echo(scores_table([table(exam) for exam in masked]))
    if len(masked) == 1:
        named = ", ".join(f"{name} {score}" for name, score in worst(masked[0]))
        click.echo(f"\nLowest accuracy, top 1: {named}.")


if __name__ == "__main__":
    main()

"""Phrases that the small OpenCLIP was not taught, asked of finished scenes, against what chance would find.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/metrics.json
    PYTHONPATH=. python benchmarks/open_vocabulary.py results/adt/scene{1,2,3,4,5} > benchmarks/open_vocabulary.md

Synonyms that are in no caption, or in neither captions nor the glossary that trains the text tower alone; and colours with
names ("green bottle"), of which one pair in eight was left out of what the model was shown. Phrases are answered and scored
by the functions of the stage `metrics`. A thing's true colour is that of the surfaces it was made of, by the captions' rule:
the largest share of what is seen of it, 0.4 at least; where another thing of the category has the colour in part, it is not
asked. Phrases that relate things ("the bottle on the table") are not asked.
"""

import sys
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path

import click
from scores_bench.comparing import METHOD, Paired, accuracy_difference, told
from vocabulary_bench.answering import Answered, answer_scene
from vocabulary_bench.phrases import KINDS, LEFT_OUT_PAIR, NAME
from vocabulary_bench.questions import TARGETS, TOLD_APART

from egosplat.doctor.configured import read_configuration
from egosplat.errors import UserError
from egosplat.evaluation.intervals import (
    RESAMPLING,
    Clusters,
    bounds_of,
    cluster,
    clustered_interval,
    mean_of_scenes,
    scaled,
)
from egosplat.pipeline.scenes import find_scene, read_scenes
from egosplat.progress import log
from egosplat.tables.scored_scenes import UNTOUCHED
from egosplat.tables.table import Cell

HEADER = (
    "| what is meant | asked by | queries | phrases | categories | accuracy | a random pixel | the middle of the picture | mIoU "
    "| against the name alone, same targets |\n| --- | --- |" + " ---: |" * 8
)

Scenes = Sequence[Sequence[Answered]]


def values(scenes: Scenes, name: str) -> list[Clusters]:
    """A number of each scene's results by category."""
    return [
        cluster(
            [float(getattr(one.result, name)) for one in answered],
            [one.question.category for one in answered],
        )
        for answered in scenes
    ]


def score(scenes: Scenes, name: str) -> Cell:
    """The mean over scenes in percent with its interval."""
    clusters = values(scenes, name)
    return Cell(
        percent=100 * mean_of_scenes(clusters),
        interval=scaled(bounds_of(clustered_interval(clusters, RESAMPLING)), 100),
        categories=sum(len(one.counts) for one in clusters),
    )


def against(mine: Sequence[Answered], theirs: Sequence[Answered]) -> Paired:
    """A scene's results against those of other phrases for the same targets."""
    other = {(one.question.query.frame, one.question.query.instances["all"]): one.result for one in theirs}
    pairs = [(one, other[one.question.query.frame, one.question.query.instances["all"]]) for one in mine]
    hits = [int(one.result.hit) - int(result.hit) for one, result in pairs]
    ious = [one.result.iou - result.iou for one, result in pairs]
    categories = [one.question.category for one, _ in pairs]
    return Paired(cluster(hits, categories), cluster(ious, categories), hits.count(1), hits.count(-1))


def row(targets: str, kind: str, scenes: Scenes, names: Scenes) -> str:
    """The line of one kind of phrase; ``names`` are the results of the names alone for the same set of targets."""
    every = [one for answered in scenes for one in answered]
    hit, mean_iou = score(scenes, "hit"), score(scenes, "iou")
    compared = [against(*pair) for pair in zip(scenes, names, strict=True) if pair[0]]
    cells = [
        targets,
        kind,
        str(len(every)),
        str(len({one.question.query.category for one in every})),
        str(hit.categories),
        told(hit),
        *(f"{100 * mean_of_scenes(values(scenes, name)):.1f}" for name in ("random_hit", "middle_hit")),
        told(mean_iou),
        "" if kind == NAME else accuracy_difference(compared),
    ]
    return f"| {' | '.join(cells)} |"


def rows(scenes: Scenes) -> Iterator[str]:
    """A line of each kind of phrase for each set of targets."""
    asked = {(one.question.targets, one.question.kind) for answered in scenes for one in answered}
    for targets, kind in (pair for pair in product(TARGETS, KINDS) if pair in asked):
        chosen, names = (
            [
                [one for one in answered if (one.question.targets, one.question.kind) == (targets, which)]
                for answered in scenes
            ]
            for which in (kind, NAME)
        )
        yield row(targets, kind, chosen, names)


def left_out(scenes: Scenes) -> str:
    """How many left-out pairs there were, and which."""
    every = [one.question for answered in scenes for one in answered if one.question.kind == LEFT_OUT_PAIR]
    pairs = sorted({one.query.category for one in every})
    beside = sorted({one.query.category for one in every if one.targets == TOLD_APART})
    listed = f": {', '.join(pairs)}" if pairs else ""
    return (
        f"Pairs of colour and name that were left out of training and are seen here: {len(pairs)}{listed}. Beside other "
        f"things of their category: {len(beside)}."
    )


@click.command(help=__doc__)
@click.argument(
    "folders", nargs=-1, required=True, type=click.Path(exists=True, file_okay=False, path_type=Path)
)
@click.option("--configfile", "files", multiple=True, type=click.Path(exists=True, path_type=Path))
@click.option("--config", "options", multiple=True, help="As Snakemake's: what the scenes were made with.")
def main(folders: tuple[Path, ...], files: tuple[Path, ...], options: tuple[str, ...]) -> None:
    """Print the table."""
    table = read_scenes(read_configuration(files, options)[0])
    apart = [folder for folder in folders if folder.name in UNTOUCHED]
    chosen_by = [folder for folder in folders if folder not in apart]
    click.echo("# Phrases that were not taught\n")
    click.echo(f"`benchmarks/open_vocabulary.py`. Origin synthetic, the small checkpoints; percent. {METHOD}")
    for title, own in (("Apartments", chosen_by), ("Untouched apartments", apart)):
        if own:
            scenes = []
            for folder in own:
                log(f"{folder}")
                scenes.append(answer_scene(folder, find_scene(table, folder.parent.name, folder.name).config))
            names = ", ".join(f"{folder.parent.name}/{folder.name}" for folder in own)
            click.echo(f"\n## {title}: {names}\n\n{HEADER}")
            click.echo("\n".join(rows(scenes)))
            click.echo(f"\n{left_out(scenes)}")


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        sys.exit(f"open_vocabulary.py: {error}")

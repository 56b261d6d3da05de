"""Queries of finished scenes with phrases that the small OpenCLIP was not taught, against chance.

    snakemake --cores 2 results/adt/scene{1,2,3,4,5}/metrics.json
    python -m benchmarks.open_vocabulary results/adt/scene{1,2,3,4,5} > benchmarks/open_vocabulary/README.md

The phrases are synonyms that are in no caption, or in neither the captions nor the glossary that trains the text tower alone;
and colors with names ("green bottle"), where one pair in eight was left out of training. The functions of the stage `metrics`
answer and score them. A thing's true color comes from its surfaces by the captions' rule: the largest visible share, at least
0.4. A color is not asked where another thing of the category has it in part. Phrases that relate two things ("the bottle on
the table") are not asked.
"""

from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path

import click

from benchmarks.common import command, markdown, scene_folders
from benchmarks.open_vocabulary.answering import Answered, answer_scene
from benchmarks.open_vocabulary.phrases import KINDS, LEFT_OUT_PAIR, NAME
from benchmarks.open_vocabulary.questions import TARGETS, TOLD_APART
from benchmarks.scores import METHOD, Paired, accuracy_difference, differences, format_score
from egosplat.doctor.inputs import read_configuration
from egosplat.evaluation.intervals import RESAMPLING, Clusters, cluster, clustered_interval, mean_of_scenes
from egosplat.pipeline.home import title_of
from egosplat.pipeline.scenes import find_scene, read_scenes
from egosplat.progress import log
from egosplat_rivals.scored_scenes import VALIDATION, Cell, percent_bounds

COLUMNS = (
    "things",
    "asked by",
    "queries",
    "phrases",
    "categories",
    "accuracy",
    "a random pixel",
    "the middle of the picture",
    "mIoU",
    "against the name only, same things",
)

Scenes = Sequence[Sequence[Answered]]


def values(scenes: Scenes, name: str) -> list[Clusters]:
    """One number of each result, by category, of each scene."""
    return [
        cluster(
            [float(getattr(one.result, name)) for one in answered],
            [one.question.category for one in answered],
        )
        for answered in scenes
    ]


def score(scenes: Scenes, name: str) -> Cell:
    """Mean of one number over scenes in percent, with its interval."""
    clusters = values(scenes, name)
    return Cell(
        percent=100 * mean_of_scenes(clusters),
        interval=percent_bounds(clustered_interval(clusters, RESAMPLING)),
        categories=sum(len(one.counts) for one in clusters),
    )


def against(mine: Sequence[Answered], theirs: Sequence[Answered]) -> Paired:
    """Paired differences between the results of two kinds of phrases for the same things of one scene."""

    def target(one: Answered) -> tuple[int, tuple[int, ...]]:
        return one.question.query.frame, one.question.query.instances["all"]

    other = {target(one): one.result for one in theirs}
    pairs = [(one.question.category, one.result, other[target(one)]) for one in mine]
    return differences([(name, (int(a.hit), a.iou), (int(b.hit), b.iou)) for name, a, b in pairs])


def row(targets: str, kind: str, scenes: Scenes, names: Scenes) -> list[str]:
    """The row of one kind of phrase; ``names`` are the results of plain names for the same things."""
    every = [one for answered in scenes for one in answered]
    hit = score(scenes, "hit")
    compared = [against(*pair) for pair in zip(scenes, names, strict=True) if pair[0]]
    return [
        targets,
        kind,
        str(len(every)),
        str(len({one.question.query.category for one in every})),
        str(hit.categories),
        format_score(hit),
        *(f"{100 * mean_of_scenes(values(scenes, name)):.1f}" for name in ("random_hit", "middle_hit")),
        format_score(score(scenes, "iou")),
        "" if kind == NAME else accuracy_difference(compared),
    ]


def rows(scenes: Scenes) -> Iterator[list[str]]:
    """A row for each kind of phrase and each set of things."""

    def chosen(targets: str, kind: str) -> Scenes:
        wanted = (targets, kind)
        return [[a for a in scene if (a.question.targets, a.question.kind) == wanted] for scene in scenes]

    asked = {(one.question.targets, one.question.kind) for answered in scenes for one in answered}
    for targets, kind in product(TARGETS, KINDS):
        if (targets, kind) in asked:
            yield row(targets, kind, chosen(targets, kind), chosen(targets, NAME))


def left_out(scenes: Scenes) -> str:
    """A sentence that lists the pairs of color and name left out of training and seen in the scenes."""
    every = [one.question for answered in scenes for one in answered if one.question.kind == LEFT_OUT_PAIR]
    pairs = sorted({one.query.category for one in every})
    beside = {one.query.category for one in every if one.targets == TOLD_APART}
    listed = f": {', '.join(pairs)}" if pairs else ""
    return (
        f"Pairs of color and name that were left out of training and are visible here: {len(pairs)}{listed}. Next to other "
        f"things of their category: {len(beside)}."
    )


@command(__doc__)
@scene_folders
@click.option("--configfile", "files", multiple=True, type=click.Path(exists=True, path_type=Path))
@click.option("--config", "options", multiple=True, help="As for Snakemake: settings of the scenes.")
def main(folders: tuple[Path, ...], files: tuple[Path, ...], options: tuple[str, ...]) -> None:
    """Print the tables."""
    table = read_scenes(read_configuration(files, options)[0])
    apart = [folder for folder in folders if folder.name in VALIDATION]
    tuning = [folder for folder in folders if folder not in apart]
    click.echo(
        "# Phrases that were not taught\n\n`python -m benchmarks.open_vocabulary`. Synthetic apartments, the small "
        f"checkpoints; percent. {METHOD}"
    )
    for title, own in (("Apartments", tuning), ("Validation apartments", apart)):
        if own:
            scenes = []
            for folder in own:
                log(f"{folder}")
                scenes.append(answer_scene(folder, find_scene(table, folder.parent.name, folder.name).config))
            click.echo(f"\n## {title}: {', '.join(map(title_of, own))}\n")
            click.echo(f"{markdown(COLUMNS, rows(scenes), words=2)}\n\n{left_out(scenes)}")


if __name__ == "__main__":
    main()

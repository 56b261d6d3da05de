"""How much of what is in a room its catalog tells, and rightly.

    snakemake --cores 2 results/adt/scene1/metrics.json
    python -m benchmarks.catalog results/adt/scene1 --output benchmarks/catalog

Each thing that is told lies on the annotated thing that has most of its pixels in the evaluation frames. It is told rightly by a
name that captions of the small OpenCLIP's training have for that thing, or by a synonym. Pieces of the building are annotated as one
thing: a name of any of them is right there. Things that are told twice, and parts, are counted apart.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np
import pandas as pd

from benchmarks.common import command, markdown, scene_folders, time_call
from egosplat.drawing import draw_mask, empty_grid, plt
from egosplat.evaluation.evaluation_frames import Evaluation
from egosplat.evaluation.options import MetricsOptions
from egosplat.evaluation.presence import LEAST_PIXELS, annotated_shares
from egosplat.images import encode_webp
from egosplat.pipeline.home import title_of
from egosplat.query.answers import Answer
from egosplat.query.catalog import catalog
from egosplat.query.finished_scene import Scene
from egosplat.query.grades import FOUND
from egosplat.query.text import name_parts
from egosplat.report.sheets.queries_sheet import evaluation_of
from egosplat_rivals.methods_sheet import open_scored
from training.small_models.concepts import KINDS, WHOLES
from training.small_models.glossary import GLOSSARY

BUILDING = "shelter"
_PIECES = ("floor", "ceiling", "wall", "door", "window", "rug", "lamp", "curtain", "door mat")

# Verdicts with their colors in the picture.
VERDICTS = {
    "right": "green",
    "building": "gray",
    "again": "steelblue",
    "part": "darkorange",
    "wrong": "crimson",
}


@dataclass(frozen=True)
class Told:
    """A thing of a catalog: its place among the answers, and the annotated thing that has most of it, if one has."""

    scene: str
    name: str
    grade: str
    probability: float
    verdict: str
    thing: str


def names_of(category: str) -> set[str]:
    """What a thing of a category may be called."""
    wholes = _PIECES if category == BUILDING else (category,)
    kinds = [names for names, listed in KINDS.items() if {*wholes} & {*listed.split(",")}]
    return {
        name for whole in wholes for name in (whole, *WHOLES.get(whole, ()), *GLOSSARY.get(whole, ()))
    }.union(*kinds)


def judge(answers: Sequence[Answer], scene: Scene, evaluation: Evaluation) -> Iterator[Told]:
    """Tell what each thing of a catalog shows."""
    categories = {one.name: one.category for one in evaluation.instances}
    by_name = replace(evaluation, instances=[replace(one, category=one.name) for one in evaluation.instances])
    shares, names = annotated_shares(scene.trained, [answer.things[0] for answer in answers], by_name)
    seen: set[str] = set()
    for answer, row in zip(answers, shares, strict=True):
        thing, verdict = [*names, "nothing"][int(row.argmax())], "wrong"
        known = names_of(categories.get(thing, thing))
        if row.sum() >= LEAST_PIXELS and answer.phrase in known:
            building = categories.get(thing) == BUILDING
            verdict = "building" if building else "again" if thing in seen else "right"
            seen.add(thing)
        elif answer.phrase in name_parts(known):
            verdict = "part"
        yield Told(
            title_of(scene.folder), answer.phrase, answer.grade, round(answer.rating, 3), verdict, thing
        )


def things_seen(evaluation: Evaluation) -> set[str]:
    """The annotated things that a query of the evaluation asks for, but people."""
    asked = {
        one for query in evaluation.find_queries(MetricsOptions()) for one in query.instances.get("all", ())
    }
    things = (evaluation.instances[one] for one in asked)
    return {one.name for one in things if one.instance_type != "human" and one.category != BUILDING}


def table(told: pd.DataFrame, seen: int, seconds: float) -> str:
    """Counts of the verdicts, with precision and recall, of what is found, and of best guesses with it."""
    rows = []
    for name, some in (("found", told[told.grade == FOUND]), ("and best guesses", told)):
        counts = some.verdict.value_counts()
        right = counts.get("right", 0)
        judged = len(some) - counts.get("building", 0)
        shares = f"{right / max(judged, 1):.0%}", f"{right / max(seen, 1):.0%}"
        rows.append([name, len(some), *(counts.get(verdict, 0) for verdict in VERDICTS), *shares])
    head = ["told", "things", *VERDICTS, "precision", f"recall of {seen}"]
    return f"{markdown(head, rows)}\n\n{seconds:.1f} CPU-s for all names."


def draw(answers: Sequence[Answer], told: Sequence[Told], scene: Scene, output: Path) -> None:
    """Draw each thing in the photograph that shows it best, with its verdict."""
    rows, columns = -(-len(answers) // 8), 8
    figure = plt.figure(figsize=(1.7 * columns, 2.0 * rows), layout="constrained")
    for cell, answer, one in zip(empty_grid(figure, rows, columns).flat, answers, told, strict=False):
        frame = answer.things[0].frame
        shown = scene.show(answer.phrase, answer.things[0], 128).mask
        draw_mask(cell, scene.frames[frame] / np.float32(255), shown)
        cell.set_title(
            f"{one.name} {one.probability:.2f}\n{one.verdict}", fontsize=8, color=VERDICTS[one.verdict]
        )
    figure.canvas.draw()
    output.write_bytes(encode_webp(np.asarray(figure.canvas.buffer_rgba())[..., :3], 80).tobytes())
    plt.close(figure)


@command(__doc__)
@scene_folders
@click.option("--output", type=click.Path(path_type=Path), help="Folder for things.tsv and things.webp.")
def main(folders: tuple[Path, ...], output: Path | None) -> None:
    """Print the table of all scenes."""
    rows, seen, seconds = [], 0, 0.0
    for folder in folders:
        scene = open_scored(folder, MetricsOptions(), in_time=True)
        scene.surface, scene.clip  # noqa: B018
        answers, taken = time_call(catalog, scene)
        answers = [answer for answer in answers if answer.things]
        evaluation = evaluation_of(scene)
        told = [*judge(answers, scene, evaluation)]
        rows, seen, seconds = [*rows, *told], seen + len(things_seen(evaluation)), seconds + taken
        if output is not None:
            draw(answers, told, scene, output / "things.webp")
    every = pd.DataFrame(rows)
    if output is not None:
        every.to_csv(output / "things.tsv", sep="\t", index=False)
    click.echo(table(every, seen, seconds))


if __name__ == "__main__":
    main()

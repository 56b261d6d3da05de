"""Questions for how things stand to each other, in finished scenes of apartments, against what stands there.

    snakemake --cores 2 results/adt/{scene1,busy1}/metrics.json
    python -m benchmarks.relations results/adt/{scene1,busy1}

A scene is asked twenty questions, ten of them true, of categories that its evaluation frames show and that stay where they are. On is
true of what the apartment was furnished with on; other relations follow from the true boxes, by the rule that answers follow.
"""

from collections.abc import Iterator, Sequence
from itertools import permutations, zip_longest
from pathlib import Path

import click
import numpy as np
import pandas as pd

from benchmarks.common import command, markdown, scene_folders
from egosplat.doctor.inputs import read_configuration
from egosplat.pipeline.home import title_of
from egosplat.pipeline.scenes import find_scene, read_scenes
from egosplat.pipeline.validation import read_document
from egosplat.query.finished_scene import open_scene
from egosplat.query.relations import Body, is_between, stands
from egosplat_apartments.world.layout import Placed
from egosplat_apartments.world.world import World, make_world

ROWS = Path(__file__).with_name("rows.csv")
EACH = 10
RELATIONS = ("on", "next to", "above", "under", "in", "between")

# Words of a question: a thing, a relation, and one anchor or two.
Words = tuple[str, str, tuple[str, ...]]


def staying(world: World) -> list[Placed]:
    """The things of an apartment that nobody carries."""
    return [thing for thing in world.apartment.things if thing.number not in world.jobs_of]


def holds(things: Sequence[Placed], thing: Placed, relation: str, anchors: Sequence[Placed]) -> bool:
    """Whether a thing stands to others, of which it is none."""
    if thing in anchors:
        return False
    if relation == "on":
        return thing.support == anchors[0].number
    # World axes have y up.
    own, *others = (Body(one.bounds[:, [0, 2, 1]], np.zeros((0, 3))) for one in (thing, *anchors))
    return is_between(own, *others) if relation == "between" else stands(relation, own, others[0])


def is_true(things: Sequence[Placed], words: Words) -> bool:
    """Whether one of the things with these names stands so."""
    name, relation, names = words
    named = [[one for one in things if one.kind.category == each] for each in (name, *names)]
    groups = np.stack(np.meshgrid(*[np.arange(len(some)) for some in named], indexing="ij"), -1)
    every = (
        [some[row] for some, row in zip(named, rows, strict=True)] for rows in groups.reshape(-1, len(named))
    )
    return any(holds(things, group[0], relation, group[1:]) for group in every)


def questions(things: Sequence[Placed], names: Sequence[str]) -> Iterator[tuple[Words, bool]]:
    """Ten true and ten false questions, in turn of each relation; the same for the same apartment."""
    rng = np.random.default_rng(0)
    found: dict[bool, list[list[Words]]] = {True: [], False: []}
    for relation in RELATIONS:
        count = 3 if relation == "between" else 2
        every: list[Words] = [(one, relation, tuple(others)) for one, *others in permutations(names, count)]
        chosen = [every[row] for row in rng.permutation(len(every))[:2000]]
        for truth, by_relation in found.items():
            by_relation.append([words for words in chosen if is_true(things, words) == truth][:EACH])
    for truth, by_relation in found.items():
        turns = [words for turn in zip_longest(*by_relation) for words in turn if words is not None]
        yield from ((words, truth) for words in turns[:EACH])


def ask(folder: Path, world: World) -> Iterator[dict[str, object]]:
    """Ask a finished scene, a row a question."""
    document, scene, things = (
        read_document(folder / "metrics.json", "metrics"),
        open_scene(folder),
        staying(world),
    )
    shown = [
        one["phrase"] for one in document["presence"]["queries"] if one["present"] and not one["untaught"]
    ]
    names = [name for name in shown if any(thing.kind.category == name for thing in things)]
    for (name, relation, anchors), truth in questions(things, names):
        question = f"{name} {relation} the {' and the '.join(anchors)}"
        answer = scene.ask(question)[0]
        lacks = "none seen" if ", but none is seen " in str(answer.refusal) else "not found"
        yield {
            "scene": title_of(folder),
            "question": question,
            "true": int(truth),
            "told": "yes" if answer.things else lacks,
        }


def summary(rows: pd.DataFrame) -> str:
    """A table by scene and truth."""
    table = [
        (
            scene,
            "true" if true else "false",
            len(own),
            *(own["told"].eq(told).sum() for told in ("yes", "none seen", "not found")),
        )
        for scene, of_scene in rows.groupby("scene", sort=False)
        for true, own in of_scene.groupby("true", sort=False)
    ]
    return markdown(("scene", "questions", "asked", "told yes", "none seen", "not found"), table, words=2)


@command(__doc__)
@scene_folders
@click.option("--configfile", "files", multiple=True, type=click.Path(exists=True, path_type=Path))
def main(folders: tuple[Path, ...], files: tuple[Path, ...]) -> None:
    """Write the rows beside this file, and print their table."""
    table, rows = read_scenes(read_configuration(files, ())[0]), []
    for folder in folders:
        film = find_scene(table, folder.parent.name, folder.name).config["synthetic"]
        world = make_world(**{key: film[key] for key in ("seed", "seconds", "objects", "motion", "world")})
        rows += ask(folder, world)
    found = pd.DataFrame(rows)
    found.to_csv(ROWS, index=False)
    click.echo(summary(found))


if __name__ == "__main__":
    main()

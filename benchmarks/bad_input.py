"""Bad input of every kind, each against the stage, the command or the workflow that meets it.

    python benchmarks/bad_input.py docs/bad_input.md --seed 0

A small scene is made once. Each try breaks something in a copy of it and calls the command in a process of its own; what
it says, what it leaves behind and what it touches elsewhere are looked at. The table counts them by family.
"""

import random
import tempfile
from collections import Counter
from pathlib import Path
from types import ModuleType

import click
from bad_input_bench import (
    artifacts,
    configuration,
    descriptions,
    documents,
    hoi4d,
    models,
    outputs,
    pictures,
    questions,
    recordings,
    relevancy,
    table_of_scenes,
    workflow,
)
from bad_input_bench.attempts import attempt
from bad_input_bench.cases import Case
from bad_input_bench.report import Tried, page
from bad_input_bench.scene import import_all, make
from bad_input_bench.verdicts import ACCEPTED, CLEAR, judge, message

from egosplat.progress import log, track

LIGHT = (configuration, table_of_scenes)
"""Families that meet no stage: a small process is forked much faster."""

HEAVY = (
    recordings,
    pictures,
    hoi4d,
    artifacts,
    documents,
    models,
    descriptions,
    questions,
    relevancy,
    outputs,
)


def tried(case: Case, finished: Path, root: Path, baselines: dict[str, str | None]) -> Tried:
    """Try one case. Undisturbed results are made once a command, and remembered in ``baselines``."""
    undisturbed = None
    if case.undisturbed is not None:
        key = case.name.partition(":")[0]
        if key not in baselines:
            baselines[key] = attempt(case, finished, root, undisturbed=True).digest
        undisturbed = baselines[key]
    said = attempt(case, finished, root)
    verdict = judge(case, said, undisturbed)
    if verdict not in (CLEAR, ACCEPTED):
        log(f"{verdict}: {case.family}: {case.name}\n{said.text[-1500:]}\n{said.made}\n")
    return Tried(case.family, case.name, verdict, message(said.text), case.fine)


def try_all(
    families: tuple[ModuleType, ...],
    rng: random.Random,
    finished: Path,
    root: Path,
    only: tuple[str, ...],
    most: int,
) -> list[Tried]:
    """Try the cases of some families whose name begins so, at most so many of each."""
    cases: dict[str, list[Case]] = {}
    for case in (case for family in families for case in family.cases(rng)):
        if case.family.startswith(only or ("",)):
            cases.setdefault(case.family, []).append(case)
    chosen = [case for own in cases.values() for case in _some(own, rng, most)]
    baselines: dict[str, str | None] = {}
    return [tried(case, finished, root, baselines) for case in track(chosen, "trying", unit="input")]


def _some(cases: list[Case], rng: random.Random, most: int) -> list[Case]:
    """At most so many of them, in their order."""
    return [cases[index] for index in sorted(rng.sample(range(len(cases)), min(most, len(cases))))]


@click.command(help=__doc__)
@click.argument("output", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--seed", default=0, show_default=True)
@click.option(
    "--most", default=1000, show_default=True, help="Tries of a family; more are left out at random."
)
@click.option(
    "--scene", type=click.Path(path_type=Path), help="A finished folder from before, to save its time."
)
@click.option("--only", multiple=True, help="Families that begin so alone; nothing is written.")
def main(output: Path, seed: int, most: int, scene: Path | None, only: tuple[str, ...]) -> None:
    """Try everything and write the page."""
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        root = Path(name) / "try"
        finished = scene.resolve() if scene else make(Path(name) / "finished")
        results = try_all(LIGHT, rng, finished, root, only, most)
        if workflow.FAMILY.startswith(only or ("",)):
            results += workflow.tries(finished, root)
        import_all()
        results += try_all(HEAVY, rng, finished, root, only, most)
    for verdict, count in sorted(Counter(one.verdict for one in results).items()):
        log(f"{verdict}: {count}")
    if not only:
        output.write_text(page(results, seed, most), encoding="utf-8")


if __name__ == "__main__":
    main()

"""Processor time of each stage in two checkouts, on the same inputs.

    python -m benchmarks.stage_times --rounds 3 ../before . results/adt/scene1 > table.md

OLD and NEW are roots of checkouts with built kernels, SCENE is a finished scene that both can read. A stage runs in a process
of its own on one thread, once in OLD and once in NEW in each round, so that other work on the machine slows both alike. Its
keys are the defaults of each checkout. The inputs are those of SCENE: a stage that reads more, or less, than before gets
what its command asks for. The last rows are commands at work: the help, and queries of the scene.
"""

import os
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import click

from benchmarks.common import command, cpu_seconds_of, markdown
from egosplat.pipeline.stages import STAGES
from egosplat.progress import log

# Stages of the main job, in its order; a checkout may lack some.
MAIN_JOB = (
    "synthetic",
    "frames",
    "annotations",
    "poses",
    "survey",
    "transient",
    "segments",
    "instances",
    "view_features",
    "features",
    "masks",
    "splats",
    "language",
    "metrics",
)

# What the workflow decides for a stage: masks in a scene where something moves.
DECIDED = {"splats": ("--set", "masking=refined")}

# Flags that the table of scenes gives.
OF_SCENE = {"--format": "adt"}

QUESTIONS = ("couch", "lamp")

_PATH_FLAG = re.compile(r"^  (--[a-z-]+) PATH", re.MULTILINE)


@dataclass(frozen=True)
class Checkout:
    """One version of egosplat; ``root`` is the root of its repository."""

    root: Path

    def words(self, *arguments: object) -> list[str]:
        """A call of its command line."""
        return [sys.executable, "-c", "from egosplat.cli import main; main()", *map(str, arguments)]

    @property
    def environment(self) -> dict[str, str]:
        """Variables with which Python finds its sources; one thread."""
        return {"PYTHONPATH": str(self.root.resolve() / "src"), "OMP_NUM_THREADS": "1"}

    def seconds(self, *arguments: object) -> float:
        """Processor time of a command [s].

        Raises:
            UserError: it failed.
        """
        return cpu_seconds_of(self.words(*arguments), self.root, **self.environment)

    def path_flags(self, stage: str) -> list[str]:
        """Flags of a stage's command that take a path; none if the checkout lacks the stage."""
        done = subprocess.run(
            self.words(stage.replace("_", "-"), "--help"),
            check=False,
            cwd=self.root,
            env=os.environ | self.environment,
            capture_output=True,
            text=True,
        )
        return _PATH_FLAG.findall(done.stdout)


def input_flags(flags: list[str], scene: Path) -> list[str]:
    """The flags of a stage with the files of a scene; files that the scene lacks are left out."""
    files = {f"--{name.replace('_', '-')}": scene / STAGES[name].output for name in MAIN_JOB}
    files["--recording"] = scene / "recording"
    given = [(flag, files[flag]) for flag in flags if flag in files and files[flag].exists()]
    return [word for flag, path in given for word in (flag, str(path.resolve()))]


def stage_seconds(checkout: Checkout, stage: str, flags: list[str], scene: Path) -> float:
    """Processor time of a stage [s]; its output is removed."""
    words = [*input_flags(flags, scene), *DECIDED.get(stage, ())]
    if stage == "frames":
        words += [word for pair in OF_SCENE.items() for word in pair]
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / STAGES[stage].output
        return checkout.seconds(stage.replace("_", "-"), *words, "--output", output)


def times(checkouts: list[Checkout], stage: str, scene: Path, rounds: int) -> list[float]:
    """Median processor time of a stage in each checkout that has it, measured in turns."""
    flags = [checkout.path_flags(stage) for checkout in checkouts]
    found: list[list[float]] = [[] for _ in checkouts]
    for _ in range(rounds):
        for checkout, own, measured in zip(checkouts, flags, found, strict=True):
            if own:
                measured.append(stage_seconds(checkout, stage, own, scene))
                log(f"{stage} in {checkout.root}: {measured[-1]:.1f} CPU-s")
    return [median(one) if one else 0.0 for one in found]


def command_times(checkouts: list[Checkout], scene: Path, rounds: int) -> dict[str, list[float]]:
    """Median processor time of the help and of a query, in each checkout."""
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "query.png"
        calls = {
            "egosplat --help": ("--help",),
            "egosplat query": ("query", scene.resolve(), *QUESTIONS, "--output", picture),
        }
        return {
            name: [
                median(one)
                for one in zip(
                    *([checkout.seconds(*call) for checkout in checkouts] for _ in range(rounds)), strict=True
                )
            ]
            for name, call in calls.items()
        }


def row(name: str, seconds: list[float]) -> list[str]:
    """A row of the table: processor time before and after, and the ratio."""
    before, after = seconds
    return [name, f"{before:.1f}", f"{after:.1f}", f"{after / before:.2f}" if before and after else "-"]


@command(__doc__)
@click.option("--rounds", default=1, show_default=True, help="Runs of each stage in each checkout.")
@click.option("--stage", "stages", multiple=True, help="Stage to measure; may be repeated.  [default: all]")
@click.argument("old", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.argument("new", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.argument("scene", type=click.Path(exists=True, file_okay=False, path_type=Path))
def main(rounds: int, stages: tuple[str, ...], old: Path, new: Path, scene: Path) -> None:
    """Print the table."""
    checkouts = [Checkout(old), Checkout(new)]
    measured = {stage: times(checkouts, stage, scene, rounds) for stage in stages or MAIN_JOB}
    rows = [row(f"`{stage}`", seconds) for stage, seconds in measured.items()]
    if not stages:
        sums = [sum(seconds) for seconds in zip(*measured.values(), strict=True)]
        rows.append(row("all stages", sums))
        commands = command_times(checkouts, scene, rounds)
        rows += [row(f"`{name}`", seconds) for name, seconds in commands.items()]
    click.echo(markdown(["", "before [CPU-s]", "after [CPU-s]", "ratio"], rows))


if __name__ == "__main__":
    main()

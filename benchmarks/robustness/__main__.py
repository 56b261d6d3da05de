"""Kills and full disks in every stage of a small scene; the same command must then finish with the same scores.

    python -m benchmarks.robustness kills
    python -m benchmarks.robustness disks

Each time, a finished scene loses one artifact and everything made from it. While the artifact is made again, `kills` sends
SIGKILL to the stage or to Snakemake at a random moment, and `disks` leaves the disk without a byte. Afterwards no artifact may be
half written, and the same command must finish, leave nothing over, and give the same scores. Each command prints a table of
benchmarks/robustness/README.md. `disks` mounts a file system: run it as root or after `unshare --user --map-root-user --mount`.
"""

import random
import re
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import click
import pandas as pd
import psutil

from benchmarks.common import markdown
from benchmarks.robustness.scene import ARTIFACTS, Scene, finished_scene
from benchmarks.robustness.small_disk import NoMountError, SmallDisk
from egosplat.progress import log, track

_TRIES = 8
_FULL = re.compile(r"^egosplat: .*No space left on device", re.MULTILINE)

# Cells of one attempt by column: truths, and seconds.
Outcome = dict[str, object]


def kill(finished: Scene, folder: Path, stage: str, victim: str, share: float) -> Outcome:
    """Kill ``victim`` (``stage`` or ``Snakemake``) once, and run the same command again.

    The kill comes after ``share`` of the stage's usual time. If the stage has finished by then, it starts again and the delay
    is halved.
    """
    for attempt in range(_TRIES):
        scene = finished.copy(folder)
        scene.lose(stage)
        if landed := _kill_at_work(scene, stage, victim, share * finished.seconds(stage) / 2**attempt):
            break
    sound = scene.all_sound()
    began = time.perf_counter()
    resumed = scene.resumed(finished)
    seconds = time.perf_counter() - began
    return {
        "while it worked": landed,
        "whole or absent after": sound,
        **resumed,
        "then nothing to do": resumed["resumed"] and scene.up_to_date(),
        "s to the end": seconds,
    }


def _kill_at_work(scene: Scene, stage: str, victim: str, delay_s: float) -> bool:
    """Start the command and kill some time after the stage has started.

    Returns:
        Whether the stage was still at work. In any case, nothing of the command is left running.
    """
    snakemake = scene.start()
    at_work = scene.begun(stage, snakemake)
    time.sleep(delay_s)
    landed = at_work is not None and at_work.is_running() and at_work.status() != psutil.STATUS_ZOMBIE
    if not landed:
        log(f"{stage} had ended after {delay_s:.1f} s")
    children = psutil.Process(snakemake.pid).children(recursive=True) if snakemake.poll() is None else []
    if landed and victim == "stage":
        at_work.kill()
    else:
        snakemake.kill()
    snakemake.wait()
    psutil.wait_procs(children, timeout=20)
    return landed


def fill(finished: Scene, disk: SmallDisk, stage: str) -> Outcome:
    """Fill the disk while a stage works, then make room and run the same command again."""
    transcript = disk.folder.with_name("said.txt")
    transcript.unlink(missing_ok=True)
    scene = finished.copy(disk.folder / "work", transcript)
    scene.lose(stage)
    before = scene.there()
    snakemake = scene.start()
    scene.begun(stage, snakemake)
    disk.leave(0)
    failed = snakemake.wait() != 0
    said = scene.said()
    kept = scene.all_sound() and before <= scene.there()
    disk.enlarge()
    return {
        "ended with an error": failed,
        "in one line": bool(_FULL.search(said)),
        "without a traceback": "Traceback" not in said,
        "nothing lost or half made": kept,
        **scene.resumed(finished),
    }


def table(outcomes: Sequence[tuple[str, Outcome]]) -> str:
    """A row for each stage and for all: attempts, how many of them passed each check, mean seconds."""
    stages = [stage for stage, _ in outcomes]
    frame = pd.DataFrame([outcome for _, outcome in outcomes], index=stages)
    rows = []
    for name in [*dict.fromkeys(stages), "all"]:
        own = frame if name == "all" else frame.loc[[name]]
        cells = (own[one].mean() if one.startswith("s ") else own[one].sum() for one in frame)
        rows.append([name, len(own), *(f"{cell:.0f}" for cell in cells)])
    return markdown(["stage", "times", *frame.columns], rows)


_stages = click.option(
    "--stage", "stages", multiple=True, type=click.Choice(list(ARTIFACTS)), help="only these"
)


@click.group(help=__doc__)
def main() -> None:
    """Two commands with one harness."""


@main.command()
@click.option("--kills", "count", default=3, help="of each stage; every third is of Snakemake")
@click.option("--seed", default=0)
@_stages
def kills(count: int, seed: int, stages: tuple[str, ...]) -> None:
    """Kill each stage and Snakemake at random moments."""
    rng = random.Random(seed)
    outcomes = []
    with tempfile.TemporaryDirectory() as name:
        finished = finished_scene(Path(name) / "finished")
        victims = ["Snakemake" if turn % 3 == 2 else "stage" for turn in range(count)]
        plan = [(stage, victim) for stage in stages or ARTIFACTS for victim in victims]
        for stage, victim in track(plan, "killing", unit="kill"):
            outcome = kill(finished, Path(name) / "killed", stage, victim, rng.uniform(0.05, 0.95))
            outcomes.append((stage, outcome))
    click.echo(table(outcomes))


@main.command()
@_stages
def disks(stages: tuple[str, ...]) -> None:
    """Fill the disk while each stage works."""
    outcomes = []
    with tempfile.TemporaryDirectory() as name:
        try:
            with SmallDisk(Path(name) / "disk") as disk:
                finished = finished_scene(Path(name) / "finished")
                for stage in track(stages or tuple(ARTIFACTS), "filling", unit="disk"):
                    outcomes.append((stage, fill(finished, disk, stage)))
        except NoMountError as error:
            raise click.ClickException(f"no disk can be mounted ({error}): be root, or use unshare") from None
    click.echo(table(outcomes))


if __name__ == "__main__":
    main()

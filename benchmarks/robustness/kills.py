"""Kill -9 at random moments of every stage, and of Snakemake itself; then the same command again.

    python benchmarks/reliability.py docs/reliability.md

Each time a finished small scene loses one artifact and all that is made from it; while it is made again, the stage or
Snakemake is killed. Then the same command has to end well, with the same scores as without a kill, and to leave nothing half made.
"""

import random
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import click
import psutil

from benchmarks.robustness.scene import ARTIFACTS, Scene, finished_scene
from egosplat.progress import log, track

_TRIES = 8


@dataclass(frozen=True)
class Outcome:
    """What a kill did.

    Attributes:
        landed: whether the stage was at work when it came; after: whether what was there then was whole or absent.
        resumed: whether the same command ended well; same: with the same scores; whole: and every artifact is sound,
            and nothing is left beside them; settled: and the command then finds nothing to do.
        seconds: from the kill to the end.
    """

    landed: bool
    after: bool
    resumed: bool
    same: bool
    whole: bool
    settled: bool
    seconds: float


def kill(finished: Scene, folder: Path, stage: str, victim: str, share: float) -> Outcome:
    """One kill, and the same command after it.

    Args:
        victim: ``stage`` or ``Snakemake``; share: of the stage's usual time after which it is killed. Where the stage has
            ended by then, it is begun anew and killed after half of that.
    """
    for attempt in range(_TRIES):
        scene = finished.copy(folder)
        scene.lose(stage)
        if landed := _kill_at_work(scene, stage, victim, share * finished.seconds(stage) / 2**attempt):
            break
    after = scene.all_sound()
    began = time.perf_counter()
    resumed = scene.run() == 0
    seconds = time.perf_counter() - began
    if not resumed:
        log(f"{stage}, {victim} killed after {share:.2f}: the same command failed\n{scene.said()}")
        return Outcome(landed, after, False, False, False, False, seconds)
    return Outcome(
        landed,
        after,
        resumed,
        scene.scores() == finished.scores(),
        scene.all_sound() and not scene.left_over(),
        scene.up_to_date(),
        seconds,
    )


def _kill_at_work(scene: Scene, stage: str, victim: str, delay_s: float) -> bool:
    """Begin the command and kill some time after the stage has begun: whether it was still at work.

    Either way nothing of the command runs on.
    """
    snakemake = scene.start()
    at_work = scene.begun(stage, snakemake)
    time.sleep(delay_s)
    landed = at_work is not None and at_work.is_running() and at_work.status() != psutil.STATUS_ZOMBIE
    if not landed:
        log(f"{stage} had ended after {delay_s:.1f} s")
    of_the_command = (
        psutil.Process(snakemake.pid).children(recursive=True) if snakemake.poll() is None else []
    )
    if landed and victim == "stage":
        at_work.kill()
    else:
        snakemake.kill()
    snakemake.wait()
    psutil.wait_procs(of_the_command, timeout=20)
    return landed


def table(outcomes: dict[str, list[Outcome]]) -> str:
    """Markdown, a row a stage."""
    columns = (
        "killed during",
        "kills",
        "while it worked",
        "whole or absent after",
        "went on",
        "same scores",
        "nothing left over",
        "then nothing to do",
        "s to the end",
    )
    lines = [f"| {' | '.join(columns)} |", "| --- |" + " ---: |" * (len(columns) - 1)]
    rows = [*outcomes.items(), ("all", [one for each in outcomes.values() for one in each])]
    for name, ones in rows:
        counts = [
            sum(getattr(one, field) for one in ones)
            for field in ("landed", "after", "resumed", "same", "whole", "settled")
        ]
        mean = sum(one.seconds for one in ones) / len(ones)
        lines.append(f"| {name} | {len(ones)} | {' | '.join(map(str, counts))} | {mean:.0f} |")
    return "\n".join(lines)


@click.command(help=__doc__)
@click.argument("output", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--kills", default=3, help="of each stage; every third is of Snakemake")
@click.option("--seed", default=0)
@click.option("--stage", "stages", multiple=True, type=click.Choice(list(ARTIFACTS)), help="only these")
def main(output: Path, kills: int, seed: int, stages: tuple[str, ...]) -> None:
    """Kill and write the table."""
    rng = random.Random(seed)
    outcomes: dict[str, list[Outcome]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as name:
        finished = finished_scene(Path(name) / "finished")
        made = [stage for stage in stages or ARTIFACTS if finished.output(stage).exists()]
        plan = [(stage, "Snakemake" if turn % 3 == 2 else "stage") for stage in made for turn in range(kills)]
        for stage, victim in track(plan, "killing", unit="kill"):
            outcomes[stage].append(
                kill(finished, Path(name) / "killed", stage, victim, rng.uniform(0.05, 0.95))
            )
            output.write_text(
                "# Reliability\n\nKilled with SIGKILL at random moments, the stage twice in three times, else Snakemake; then "
                f"the same command again (`benchmarks/reliability.py --kills {kills} --seed {seed}`). A small synthetic "
                f"scene, two cores; each number counts kills. A disk that fills up: [full_disk.md](full_disk.md).\n\n"
                f"{table(outcomes)}\n"
            )


if __name__ == "__main__":
    main()

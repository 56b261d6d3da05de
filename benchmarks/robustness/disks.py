"""The disk fills up while each stage works; then there is room, and the same command again.

    python benchmarks/full_disk.py docs/full_disk.md

Each time a finished small scene, on a disk of its own, loses one artifact and all that is made from it. When its stage has
begun, the disk is left without a byte. The command has to end with a plain error, to leave nothing half made and to lose
nothing; with room, it has to end well, with the same scores. Mounting a disk needs root's rights, or
`unshare --user --map-root-user --mount` before the command.
"""

import re
import tempfile
from dataclasses import dataclass, fields
from pathlib import Path

import click

from benchmarks.robustness.scene import ARTIFACTS, Scene, finished_scene
from benchmarks.robustness.small_disk import NoMountError, SmallDisk
from egosplat.progress import log, track

_TOLD = re.compile(r"^egosplat: .*No space left on device", re.MULTILINE)


@dataclass(frozen=True)
class Outcome:
    """What a full disk did; each field is a column.

    Attributes:
        failed: whether the command ended with an error; told: which said in one line what has no room; quiet: without a
            traceback.
        kept: whether what was there then was whole, and nothing that was whole before was lost.
        resumed: with room, whether the same command ended well; same: with the same scores; whole: and every artifact is
            sound, and nothing is left beside them.
    """

    failed: bool
    told: bool
    quiet: bool
    kept: bool
    resumed: bool
    same: bool
    whole: bool


COLUMNS = (
    "ended with an error",
    "in one line",
    "without a traceback",
    "nothing lost or half made",
    "with room, went on",
    "same scores",
    "nothing left over",
)


def fill(finished: Scene, disk: SmallDisk, stage: str) -> Outcome:
    """Fill the disk while a stage works."""
    transcript = disk.folder.with_name("said.txt")
    transcript.unlink(missing_ok=True)
    scene = finished.copy(disk.folder / "work", transcript)
    scene.lose(stage)
    before = _there(scene)
    snakemake = scene.start()
    scene.begun(stage, snakemake)
    disk.leave(0)
    failed = snakemake.wait() != 0
    said = scene.said()
    kept = scene.all_sound() and before <= _there(scene)
    disk.enlarge()
    resumed = scene.run() == 0
    if not resumed:
        log(f"{stage}: the same command failed\n{scene.said()}")
    return Outcome(
        failed,
        bool(_TOLD.search(said)),
        "Traceback" not in said,
        kept,
        resumed,
        resumed and scene.scores() == finished.scores(),
        scene.all_sound() and not scene.left_over(),
    )


def _there(scene: Scene) -> set[str]:
    return {stage for stage in ARTIFACTS if scene.output(stage).exists()}


def table(outcomes: dict[str, Outcome]) -> str:
    """Markdown, a row a stage."""
    lines = [f"| full during | {' | '.join(COLUMNS)} |", "| --- |" + " ---: |" * len(COLUMNS)]
    names = [field.name for field in fields(Outcome)]
    for stage, outcome in outcomes.items():
        cells = ("yes" if getattr(outcome, name) else "no" for name in names)
        lines.append(f"| {stage} | {' | '.join(cells)} |")
    counts = (str(sum(getattr(outcome, name) for outcome in outcomes.values())) for name in names)
    lines.append(f"| all {len(outcomes)} | {' | '.join(counts)} |")
    return "\n".join(lines)


@click.command(help=__doc__)
@click.argument("output", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--stage", "stages", multiple=True, type=click.Choice(list(ARTIFACTS)), help="only these")
def main(output: Path, stages: tuple[str, ...]) -> None:
    """Fill and write the table."""
    outcomes: dict[str, Outcome] = {}
    with tempfile.TemporaryDirectory() as name:
        try:
            with SmallDisk(Path(name) / "disk") as disk:
                finished = finished_scene(Path(name) / "finished")
                for stage in track(stages or tuple(ARTIFACTS), "filling", unit="disk"):
                    outcomes[stage] = fill(finished, disk, stage)
                    output.write_text(_page(outcomes))
        except NoMountError as error:
            raise SystemExit(
                f"no disk can be mounted ({error}): be root, or use unshare, see --help"
            ) from None


def _page(outcomes: dict[str, Outcome]) -> str:
    return (
        "# A full disk\n\nThe disk of the working directory was left without a byte when a stage had begun; then it was "
        "enlarged, and the same command started again (`python benchmarks/full_disk.py docs/full_disk.md`). A small "
        f"synthetic scene.\n\n{table(outcomes)}\n"
    )


if __name__ == "__main__":
    main()

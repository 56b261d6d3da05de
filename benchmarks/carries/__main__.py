"""Carries against the truth of rooms where people carry things.

    snakemake --cores 2 results/adt/busy{1,2,3,4,5}/variants/refined_masks/{metrics.json,histories.zarr}
    python -m benchmarks.carries [--true-tracks] results/adt/busy{1,2,3,4,5}/variants/refined_masks

Every thing that people carry is asked for by the name of its category. The second table is of rests.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np

from benchmarks.carries import rests as of_rests
from benchmarks.carries.places import NEAR_M, distance, places_of, rests_of, there
from benchmarks.carries.true_tracks import with_true_tracks
from benchmarks.carries.truth import TrueCarry, read_carries, recording_of
from benchmarks.common import command, markdown, scene_folders
from egosplat.histories.told import Carried
from egosplat.pipeline.home import title_of
from egosplat.progress import log
from egosplat.query.finished_scene import Scene, open_scene
from egosplat.query.text import CARRIED, SYNONYM

# A carry is found if a carry of the scene has this IoU with it in time, and ends near its end.
IOU = 0.3

# Carries that fewer frames show are not counted as seen.
LEAST_FRAMES = 4

COLUMNS = (
    "scene",
    "carries",
    "seen",
    "found",
    "named",
    "start [cm]",
    "end [cm]",
    "begin [s]",
    "end [s]",
    "told",
    "of them right",
    "told of others",
    "rests",
    "right without time",
    "at their time",
    "wrong",
    "CPU-s",
)


@dataclass(frozen=True)
class Figures:
    """Counts of one scene; lists of errors of the carries that are found, places in cm and times in s."""

    carries: int
    seen: int
    found: int
    named: int
    errors: tuple[list[float], list[float], list[float], list[float]]
    told: int
    right: int
    of_others: int
    rests: int
    without_time: int
    at_time: int
    wrong: int

    def cells(self) -> list[object]:
        """Cells of a row."""
        medians = [f"{np.median(one):.1f}" if one else "-" for one in self.errors]
        told = self.told, self.right, self.of_others, self.rests, self.without_time, self.at_time, self.wrong
        return [self.carries, self.seen, self.found, self.named, *medians, *told]

    @staticmethod
    def total(parts: Sequence["Figures"]) -> "Figures":
        """All scenes together."""
        values = {}
        for name in Figures.__dataclass_fields__:
            columns = [getattr(one, name) for one in parts]
            values[name] = (
                tuple([value for one in lists for value in one] for lists in zip(*columns, strict=True))
                if name == "errors"
                else sum(columns)
            )
        return Figures(**values)


def measure(scene: Scene) -> Figures:
    """Compare the carries and the answers of a scene with its truth."""
    times, rests = scene.artifact("frames").read("timestamp_ns"), rests_of(scene)
    carries = read_carries(recording_of(scene.folder), rests, times)
    names = sorted({one.category for one in rests})
    answers = dict(zip(names, scene.ask(*names), strict=True))
    every = list(itertools.chain.from_iterable(scene.histories.things))
    pairs = [(one, match) for one in carries if (match := _match(one, every)) is not None]
    told = [(one, name) for name in names for one in answers[name].history]
    places = [*places_of(rests, answers)]
    at_time = sum(right for *_, right in places)
    return Figures(
        carries=len(carries),
        seen=sum(one.frames >= LEAST_FRAMES for one in carries),
        found=len(pairs),
        named=sum(_match(one, answers[one.before.category].history) is not None for one in carries),
        errors=_errors(pairs),
        told=len(told),
        right=sum(
            _is_true(one, [each for each in carries if each.before.category == name]) for one, name in told
        ),
        of_others=_of_others(scene, names),
        rests=len(rests),
        # The best thing of an answer that is not refused.
        without_time=sum(
            any(distance(best.center, place) <= NEAR_M for place in there(one, rests))
            for one in rests
            for best in answers[one.category].things[:1]
        ),
        at_time=at_time,
        wrong=sum(answered for *_, answered, _ in places) - at_time,
    )


def _of_others(scene: Scene, names: Sequence[str]) -> int:
    """The carries that answers to words for other things tell: nothing of these names is carried."""
    words, carried = scene.encode(CARRIED), scene.encode(names)
    same = (words.queries @ carried.queries.T >= SYNONYM).any(dim=1)
    others = [word for word, known in zip(CARRIED, same.tolist(), strict=True) if not known]
    return sum(len(answer.history) for answer in scene.ask(*others))


def _match(true: TrueCarry, carries: Sequence[Carried]) -> Carried | None:
    """The carry of a scene that is a true one; None if it is not found."""
    near = [one for one in carries if _is_true(one, [true])]
    return max(near, key=lambda one: true.iou(one.from_s, one.until_s), default=None)


def _is_true(one: Carried, carries: Sequence[TrueCarry]) -> bool:
    return any(
        each.iou(one.from_s, one.until_s) >= IOU and distance(one.end, each.after) <= NEAR_M
        for each in carries
    )


def _errors(pairs: Sequence[tuple[TrueCarry, Carried]]) -> tuple[list[float], ...]:
    return (
        [100 * distance(one.start, true.before) for true, one in pairs if np.isfinite(one.start).all()],
        [100 * distance(one.end, true.after) for true, one in pairs],
        [abs(one.from_s - true.before.until_s) for true, one in pairs],
        [abs(one.until_s - true.after.from_s) for true, one in pairs],
    )


@command(__doc__)
@scene_folders
@click.option("--true-tracks", "truly", is_flag=True, help="With true tracks of what moves.")
def main(folders: tuple[Path, ...], truly: bool) -> None:
    """Print the tables."""
    rows, resting, figures = [], [], []
    for folder in folders:
        log(f"{folder}")
        scene = open_scene(folder)
        histories, rests = with_true_tracks(scene) if truly else (scene.histories, scene.rests)
        if histories is None or rests is None:
            raise click.ClickException(f"{folder}: lacks histories.zarr of its Gaussians")
        scene.__dict__["histories"] = histories
        figures.append((measure(scene), of_rests.measure(scene, rests)))
        # What the rule took, if Snakemake made the scene here.
        log_file = Path("logs", folder.absolute().relative_to(Path("results").absolute()), "histories.tsv")
        took = log_file.read_text().splitlines()[1].split("\t")[-1] if log_file.exists() else "-"
        for table, part in zip((rows, resting), figures[-1], strict=True):
            table.append([title_of(folder), *part.cells(), took])
    told, lying = zip(*figures, strict=True)
    rows.append(["all", *Figures.total(told).cells(), ""])
    resting.append(["all", *of_rests.Figures.total(lying).cells(), ""])
    click.echo("\n\n".join([markdown(COLUMNS, rows), markdown(of_rests.COLUMNS, resting)]))


if __name__ == "__main__":
    main()

"""Scores of several scenes together: means with intervals, and how often a whole scene answers."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from egosplat.evaluation.intervals import RESAMPLING, bounds_of, clustered_interval, mean_of_scenes, scaled
from egosplat.tables.scored_scenes import ScoredScene
from egosplat.tables.table import Cell


def average(scenes: Mapping[str, ScoredScene], metric: str, group: str) -> Cell:
    """The plain mean over scenes, as in the paper's tables, of those that have a score.

    Its interval, by ``clustered_interval``, tells how far other categories and other scenes could move it.

    Args:
        scenes: by name, of one confidence (see ``check_protocol``).
        metric: ``accuracy`` or ``mean_iou``.
        group: one of ``egosplat.evaluation.queries.GROUPS``.
    """
    clusters = {name: scene.clusters(metric, group) for name, scene in scenes.items()}
    there = {name: own for name, own in sorted(clusters.items()) if len(own.counts)}
    if not there:
        return Cell()
    options = replace(RESAMPLING, confidence=scenes[next(iter(there))].protocol["confidence"])
    values = list(there.values())
    return Cell(
        percent=100 * mean_of_scenes(values),
        interval=scaled(bounds_of(clustered_interval(values, options)), 100),
        queries=int(sum(own.counts.sum() for own in values)),
        categories=sum(len(own.counts) for own in values),
        scenes=tuple(there),
    )


def average_chance(scenes: Mapping[str, ScoredScene], answerer: str, group: str) -> Cell:
    """The same of an accuracy by chance, see ``ScoredScene.chance``; without an interval."""
    cells = {name: scene.chance(answerer, group) for name, scene in scenes.items()}
    there = {name: cell for name, cell in sorted(cells.items()) if cell.percent is not None}
    if not there:
        return Cell()
    return Cell(percent=sum(cell.percent for cell in there.values()) / len(there), scenes=tuple(there))


@dataclass(frozen=True)
class PresenceCounts:
    """Counts of queries.

    Attributes:
        present, absent: queries of things that are there, and of things that are not.
        answered, answered_absent: how many of each were answered.
        right: answered queries whose thing mostly belongs to the category.
    """

    present: int
    answered: int
    right: int
    absent: int
    answered_absent: int

    @property
    def told(self) -> str:
        """The counts in a sentence, without a full stop."""
        return (
            f"asked of the whole scene, {self.answered} of {self.present} things that are there are answered, "
            f"{self.right} of them rightly, and {self.answered_absent} of {self.absent} that are not there"
        )


def presence_counts(scenes: Iterable[ScoredScene]) -> PresenceCounts:
    """Sum the counts of scenes; those of other methods have none."""
    entries = [scene.document["presence"] for scene in scenes if "presence" in scene.document]
    present, absent = ([entry[kind] for entry in entries] for kind in ("present", "absent"))
    return PresenceCounts(
        present=sum(one["asked"] for one in present),
        answered=sum(one["answered"] for one in present),
        right=sum(one["right"] for one in present),
        absent=sum(one["asked"] for one in absent),
        answered_absent=sum(one["answered"] for one in absent),
    )

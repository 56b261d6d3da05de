"""Average the scores of several scenes, and count how often queries of whole scenes are answered."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from egosplat.evaluation.intervals import RESAMPLING, bounds_of, clustered_interval, mean_of_scenes, scaled
from egosplat.tables.scored_scenes import ScoredScene
from egosplat.tables.table import Cell


def average(scenes: Mapping[str, ScoredScene], metric: str, group: str) -> Cell:
    """The plain mean over the scenes that have a score, as in the paper's tables, with ``clustered_interval``.

    Args:
        scenes: scenes by name, scored with one confidence (see ``check_protocol``).
        metric: ``accuracy`` or ``mean_iou``.
        group: one of ``egosplat.evaluation.queries.GROUPS``.
    """
    clusters = {name: scene.clusters(metric, group) for name, scene in sorted(scenes.items())}
    scored = {name: values for name, values in clusters.items() if len(values.counts)}
    if not scored:
        return Cell()
    options = replace(RESAMPLING, confidence=scenes[next(iter(scored))].protocol["confidence"])
    values = list(scored.values())
    return Cell(
        percent=100 * mean_of_scenes(values),
        interval=scaled(bounds_of(clustered_interval(values, options)), 100),
        queries=int(sum(scene.counts.sum() for scene in values)),
        categories=sum(len(scene.counts) for scene in values),
        scenes=tuple(scored),
    )


def average_chance(scenes: Mapping[str, ScoredScene], answerer: str, group: str) -> Cell:
    """The plain mean over scenes of the accuracy by chance, see ``ScoredScene.chance``; without an interval."""
    cells = {name: scene.chance(answerer, group) for name, scene in sorted(scenes.items())}
    scored = {name: cell for name, cell in cells.items() if cell.percent is not None}
    if not scored:
        return Cell()
    return Cell(percent=sum(cell.percent for cell in scored.values()) / len(scored), scenes=tuple(scored))


@dataclass(frozen=True)
class PresenceCounts:
    """Counts of queries of whole scenes.

    Attributes:
        present, absent: number of queries of present and of absent things.
        answered, answered_absent: number of each that were answered.
        right: number of answered queries whose thing mostly belongs to the category.
    """

    present: int
    answered: int
    right: int
    absent: int
    answered_absent: int

    @property
    def summary(self) -> str:
        """The counts in a sentence, without a full stop."""
        return (
            f"in queries of the whole scene, {self.answered} of {self.present} present things are answered, "
            f"{self.right} of them correctly, and {self.answered_absent} of {self.absent} absent things"
        )


def presence_counts(scenes: Iterable[ScoredScene]) -> PresenceCounts:
    """Sum the counts of scenes; scores of other methods have none."""
    entries = [scene.document["presence"] for scene in scenes if "presence" in scene.document]
    present, absent = ([entry[kind] for entry in entries] for kind in ("present", "absent"))
    return PresenceCounts(
        present=sum(one["asked"] for one in present),
        answered=sum(one["answered"] for one in present),
        right=sum(one["right"] for one in present),
        absent=sum(one["asked"] for one in absent),
        answered_absent=sum(one["answered"] for one in absent),
    )

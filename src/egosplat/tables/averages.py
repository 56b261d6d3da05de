"""The mean of several scenes' scores, and how far it could be chance."""

from collections.abc import Mapping
from dataclasses import replace

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

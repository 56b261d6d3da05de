"""Which of a scene's queries are shown: those that were answered best, and those that were answered worst."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ScoredQuery:
    """A query as ``metrics.json`` tells it, scored against all instances of its category.

    Attributes:
        frame: index in frames.zarr.
        category: what was asked.
        relevancy: the largest, 0..1.
        hit: whether it was found at its place.
        iou: of the mask, 0..1.
    """

    frame: int
    category: str
    relevancy: float
    hit: bool
    iou: float


def scored_queries(document: Mapping[str, Any]) -> list[ScoredQuery]:
    """All queries of a ``metrics.json``."""
    return [
        ScoredQuery(
            one["frame"],
            one["category"],
            one["relevancy"],
            one["groups"]["all"]["hit"],
            one["groups"]["all"]["iou"],
        )
        for one in document["queries"]
    ]


def best_and_worst(queries: Sequence[ScoredQuery], count: int) -> tuple[list[ScoredQuery], list[ScoredQuery]]:
    """At most ``count`` of each; a category is in one of the two, once.

    The best were found: the highest IoU first, then by frame and category. The worst were missed, and no other frame of
    their category is among the best: the lowest IoU first, of equal ones the surest (the largest relevancy), then by
    frame and category.
    """
    found = sorted((one for one in queries if one.hit), key=lambda one: (-one.iou, one.frame, one.category))
    best = _one_a_category(found, ())[:count]
    missed = sorted(
        (one for one in queries if not one.hit),
        key=lambda one: (one.iou, -one.relevancy, one.frame, one.category),
    )
    return best, _one_a_category(missed, (one.category for one in best))[:count]


def _one_a_category(queries: Iterable[ScoredQuery], taken: Iterable[str]) -> list[ScoredQuery]:
    """The first query of each category that is not taken."""
    seen = set(taken)
    first: list[ScoredQuery] = []
    for one in queries:
        if one.category not in seen:
            seen.add(one.category)
            first.append(one)
    return first

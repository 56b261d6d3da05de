"""Choose the queries to show: the best and the worst answers of a scene."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ScoredQuery:
    """A query of ``metrics.json``, scored against all instances of its category.

    Attributes:
        frame: index in frames.zarr.
        relevancy: largest smoothed relevancy, 0..1.
        hit: whether the answer hits.
        iou: IoU of the mask, 0..1.
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
    """Choose at most ``count`` best and ``count`` worst queries, each of a different category.

    The best ones hit; they are ordered by decreasing IoU. The worst ones miss, and their category is not among the best;
    they are ordered by increasing IoU, then by decreasing relevancy. Ties are ordered by frame and category.
    """
    found = sorted((one for one in queries if one.hit), key=lambda one: (-one.iou, one.frame, one.category))
    best = _one_a_category(found, ())[:count]
    missed = sorted(
        (one for one in queries if not one.hit),
        key=lambda one: (one.iou, -one.relevancy, one.frame, one.category),
    )
    return best, _one_a_category(missed, (one.category for one in best))[:count]


def _one_a_category(queries: Iterable[ScoredQuery], taken: Iterable[str]) -> list[ScoredQuery]:
    """The first query of each category outside ``taken``."""
    seen = set(taken)
    first: list[ScoredQuery] = []
    for one in queries:
        if one.category not in seen:
            seen.add(one.category)
            first.append(one)
    return first

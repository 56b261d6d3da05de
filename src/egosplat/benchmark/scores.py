"""The scores of a scene: each query by itself, and together for static, dynamic and all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.benchmark.intervals import Interval, IntervalOptions, bootstrap_interval, wilson_interval
from egosplat.benchmark.localization import accuracy, is_hit
from egosplat.benchmark.queries import GROUPS, InstanceMap, Mask, Query
from egosplat.benchmark.segmentation import iou, mean_iou


@dataclass(frozen=True)
class QueryScore:
    """Of one query, by the groups in which it counts.

    Attributes:
        hit: whether it was found at its place.
        iou: of the mask, 0..1.
    """

    hit: Mapping[str, bool]
    iou: Mapping[str, float]


@dataclass(frozen=True)
class GroupScore:
    """Of all queries of a group; NaN where there is none.

    Attributes:
        count: number of queries, pairs of a frame and a category.
        accuracy: share of them that were found at their place, 0..1, and its Wilson interval.
        mean_iou: 0..1, and its bootstrap interval.
    """

    count: int
    accuracy: float
    accuracy_interval: Interval
    mean_iou: float
    mean_iou_interval: Interval


def score_query(
    query: Query,
    candidates: NDArray[np.int64],
    mask: Mask,
    instance_map: InstanceMap,
    valid: Mask | None,
    target: str,
) -> QueryScore:
    """Compare an answer with the truth of each group; the answer is the same for all.

    Args:
        query: what was asked.
        candidates, mask: of the answer, see ``egosplat.query.answer.Answer``; (K, 2) int64 and (H, W) bool.
        instance_map: (H, W) int32 of the query's frame, see ``read_map``.
        valid: (H, W) bool pixels that show the scene, or None for all.
        target: see ``is_hit``.
    """
    groups = query.instances.items()
    return QueryScore(
        hit={name: is_hit(candidates, instance_map, own, target) for name, own in groups},
        iou={name: iou(mask, np.isin(instance_map, own), valid) for name, own in groups},
    )


def summarise(scores: Sequence[QueryScore], options: IntervalOptions) -> dict[str, GroupScore]:
    """The scores of each of ``GROUPS``."""
    return {name: _summary([one for one in scores if name in one.hit], name, options) for name in GROUPS}


def _summary(scores: Sequence[QueryScore], group: str, options: IntervalOptions) -> GroupScore:
    hits = np.array([one.hit[group] for one in scores], bool)
    ious = np.array([one.iou[group] for one in scores], np.float64)
    return GroupScore(
        count=len(scores),
        accuracy=accuracy(hits),
        accuracy_interval=wilson_interval(int(hits.sum()), len(hits), options.confidence),
        mean_iou=mean_iou(ious),
        mean_iou_interval=bootstrap_interval(ious, options),
    )

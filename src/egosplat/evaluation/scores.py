"""The scores of a scene: each query by itself, and together for static, dynamic and all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.evaluation.intervals import Interval, IntervalOptions, cluster, clustered_interval
from egosplat.evaluation.localization import is_hit, middle_hit, random_hit, target_area
from egosplat.evaluation.queries import GROUPS, InstanceMap, Mask, Query


@dataclass(frozen=True)
class Result:
    """What an answer is worth against the truth of one group.

    Attributes:
        hit: whether it was found at its place.
        iou: of the mask, 0..1.
        random_hit: probability that a random valid pixel hits, 0..1.
        middle_hit: whether the middle of the picture hits.
    """

    hit: bool
    iou: float
    random_hit: float
    middle_hit: bool


@dataclass(frozen=True)
class QueryScore:
    """Of one query.

    Attributes:
        category: what was asked; queries of one category are one cluster.
        groups: the results by the groups in which it counts.
    """

    category: str
    groups: Mapping[str, Result]


@dataclass(frozen=True)
class GroupScore:
    """Of all queries of a group; NaN where there is none.

    Attributes:
        count: number of queries, pairs of a frame and a category.
        categories: number of categories among them.
        accuracy: share of queries that were found at their place, 0..1.
        accuracy_interval: see ``clustered_interval``; None of a single category.
        mean_iou: plain mean over queries, as LangSplat's (docs/method.md#mean-iou), 0..1.
        mean_iou_interval: the same as of the accuracy.
        random_pixel, middle_pixel: accuracy of a random valid pixel, and of the middle of the picture: chance.
    """

    count: int
    categories: int
    accuracy: float
    accuracy_interval: Interval | None
    mean_iou: float
    mean_iou_interval: Interval | None
    random_pixel: float
    middle_pixel: float


def score_query(
    query: Query,
    candidates: NDArray[np.int64],
    mask: Mask,
    instance_map: InstanceMap,
    valid: Mask | None,
    hit_region: str,
) -> QueryScore:
    """Compare an answer with the truth of each group; the answer is the same for all.

    Args:
        query: what was asked.
        candidates, mask: of the answer, see ``egosplat.query.answer.Answer``; (K, 2) int64 and (H, W) bool.
        instance_map: (H, W) int32 of the query's frame, see ``read_map``.
        valid: (H, W) bool pixels that show the scene, or None for all.
        hit_region: see ``target_area``.
    """

    def result(own: Sequence[int]) -> Result:
        area = target_area(instance_map, own, hit_region)
        return Result(
            hit=is_hit(candidates, area),
            iou=iou(mask, np.isin(instance_map, own), valid),
            random_hit=random_hit(area, valid),
            middle_hit=middle_hit(area),
        )

    return QueryScore(query.category, {name: result(own) for name, own in query.instances.items()})


def iou(predicted: Mask, truth: Mask, valid: Mask | None) -> float:
    """Intersection over union of two masks, 0..1.

    Args:
        predicted, truth: (H, W) bool; the truth is seen in a valid pixel at least.
        valid: (H, W) bool pixels that count, or None for all.

    Raises:
        ValueError: shapes differ, or there is no truth: then the value is not defined.
    """
    if predicted.shape != truth.shape:
        raise ValueError(f"a mask of {predicted.shape} is compared with one of {truth.shape}")
    if valid is not None:
        predicted, truth = predicted & valid, truth & valid
    if not truth.any():
        raise ValueError("a query without a visible instance has no IoU")
    return float((predicted & truth).sum() / (predicted | truth).sum())


def summarise(scores: Sequence[QueryScore], options: IntervalOptions) -> dict[str, GroupScore]:
    """The scores of each of ``GROUPS``."""
    return {name: _summary([one for one in scores if name in one.groups], name, options) for name in GROUPS}


def _summary(scores: Sequence[QueryScore], group: str, options: IntervalOptions) -> GroupScore:
    results, categories = [one.groups[group] for one in scores], [one.category for one in scores]
    hits = cluster([one.hit for one in results], categories)
    ious = cluster([one.iou for one in results], categories)
    return GroupScore(
        count=len(scores),
        categories=len(hits.counts),
        accuracy=hits.mean,
        accuracy_interval=clustered_interval([hits], options),
        mean_iou=ious.mean,
        mean_iou_interval=clustered_interval([ious], options),
        random_pixel=cluster([one.random_hit for one in results], categories).mean,
        middle_pixel=cluster([one.middle_hit for one in results], categories).mean,
    )

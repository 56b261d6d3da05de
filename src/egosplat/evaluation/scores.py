"""Score single queries, and the groups static, dynamic and all of a scene."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.evaluation.intervals import Interval, IntervalOptions, cluster, clustered_interval
from egosplat.evaluation.queries import GROUPS, InstanceMap, Mask, Query, mask_of


@dataclass(frozen=True)
class Result:
    """Scores of an answer against the instances of one group.

    Attributes:
        iou: IoU of the mask, 0..1.
        random_hit, middle_hit: probability that a random valid pixel hits, 0..1; whether the middle pixel of the image does.
    """

    hit: bool
    iou: float
    random_hit: float
    middle_hit: bool


@dataclass(frozen=True)
class QueryScore:
    """Scores of one query, by the groups in which it counts; intervals resample categories."""

    category: str
    groups: Mapping[str, Result]


@dataclass(frozen=True)
class GroupScore:
    """Scores of all queries of a group; NaN without queries.

    Attributes:
        count: number of queries, pairs of a frame and a category.
        accuracy: share of queries that hit, 0..1.
        accuracy_interval: see ``clustered_interval``; None with fewer than two categories.
        mean_iou: plain mean over queries, as in LangSplat (docs/method.md#mean-iou), 0..1.
        mean_iou_interval: as ``accuracy_interval``.
        random_pixel, middle_pixel: accuracy of a random valid pixel and of the middle pixel (chance level).
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
    pixel: tuple[int, int] | None,
    mask: Mask,
    instance_map: InstanceMap,
    valid: Mask | None,
    hit_region: str,
) -> QueryScore:
    """Score one answer against the instances of each group.

    Args:
        pixel, mask: column and row, and (H, W) bool, see ``egosplat.query.answers.ViewMatch``.
        instance_map: (..., H, W) int32 of the query's frame, see ``read_layers``.
        valid: (H, W) bool pixels that show the scene, or None for all.
        hit_region: see ``target_area``.
    """

    def result(members: Sequence[int]) -> Result:
        area = target_area(instance_map, members, hit_region)
        return Result(
            hit=is_hit(pixel, area),
            iou=iou(mask, mask_of(instance_map, members), valid),
            random_hit=random_hit(area, valid),
            middle_hit=middle_hit(area),
        )

    return QueryScore(query.category, {name: result(members) for name, members in query.instances.items()})


def iou(predicted: Mask, target: Mask, valid: Mask | None) -> float:
    """Intersection over union of two masks, 0..1.

    Args:
        predicted, target: (H, W) bool; the target has at least one valid pixel.
        valid: (H, W) bool pixels that count, or None for all.

    Raises:
        ValueError: shapes differ, or the target is empty.
    """
    if predicted.shape != target.shape:
        raise ValueError(f"the shapes of two masks differ: {predicted.shape} and {target.shape}")
    if valid is not None:
        predicted, target = predicted & valid, target & valid
    # Queries are made from visible instances; an empty target means that another frame's map was given.
    if not target.any():
        raise ValueError("a query without a visible instance has no IoU")
    return float((predicted & target).sum() / (predicted | target).sum())


def summarise(scores: Sequence[QueryScore], options: IntervalOptions) -> dict[str, GroupScore]:
    """Scores of each of ``GROUPS``."""
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


def target_area(instance_map: InstanceMap, instances: Sequence[int], hit_region: str) -> Mask:
    """(H, W) bool pixels of a (..., H, W) int32 map that hit any of the instances, by ``metrics.hit_region``."""
    if hit_region == "mask":
        return mask_of(instance_map, instances)
    area = np.zeros(instance_map.shape[-2:], np.bool_)
    for x0, y0, x1, y1 in bounding_boxes(instance_map, instances):
        # The last column and row belong to the box.
        area[y0 : y1 + 1, x0 : x1 + 1] = True
    return area


def is_hit(pixel: tuple[int, int] | None, area: Mask) -> bool:
    """Whether a pixel, column and row, lies in the (H, W) area; False without one."""
    return pixel is not None and bool(area[pixel[1], pixel[0]])


def random_hit(area: Mask, valid: Mask | None) -> float:
    """Probability that a random one of the (H, W) bool valid pixels, None for all, hits an (H, W) area, 0..1."""
    return float((area if valid is None else area[valid]).mean())


def middle_hit(area: Mask) -> bool:
    """Whether the middle pixel of the image, (W // 2, H // 2), hits."""
    height, width = area.shape
    return bool(area[height // 2, width // 2])


def bounding_boxes(instance_map: InstanceMap, instances: Sequence[int]) -> NDArray[np.int64]:
    """(B, 4) int64 boxes of the visible instances: first column and row, last column and row [px], all inside."""
    boxes = []
    for instance in instances:
        rows, columns = np.nonzero(mask_of(instance_map, [instance]))
        if len(rows):
            boxes.append((columns.min(), rows.min(), columns.max(), rows.max()))
    return np.array(boxes, np.int64).reshape(-1, 4)

"""Whether what is asked for is found at its place (M2.4)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from egosplat.benchmark.queries import InstanceMap

TARGETS = ("box", "mask")
"""What has to be hit: an instance's bounding box, as in LangSplat, or its pixels."""


def is_hit(
    candidates: NDArray[np.int64], instance_map: InstanceMap, instances: Sequence[int], target: str
) -> bool:
    """Whether any candidate hits any of the instances.

    Args:
        candidates: (K, 2) column and row of pixels; of none nothing is hit.
        instance_map: (H, W) int32.
        instances: indices in it.
        target: one of ``TARGETS``.

    Raises:
        ValueError: the target is unknown.
    """
    columns, rows = candidates.T
    match target:
        case "mask":
            return bool(np.isin(instance_map[rows, columns], instances).any())
        case "box":
            x0, y0, x1, y1 = bounding_boxes(instance_map, instances)[:, :, None].transpose(1, 0, 2)
            return bool(((columns >= x0) & (columns <= x1) & (rows >= y0) & (rows <= y1)).any())
    raise ValueError(f"target {target!r} is none of {TARGETS}")


def bounding_boxes(instance_map: InstanceMap, instances: Sequence[int]) -> NDArray[np.int64]:
    """Boxes of what is seen of each instance, those that are not seen left out.

    Returns:
        (B, 4) int64 x0, y0, x1, y1, the first and last column and row [px].
    """
    boxes = []
    for instance in instances:
        rows, columns = np.nonzero(instance_map == instance)
        if len(rows):
            boxes.append((columns.min(), rows.min(), columns.max(), rows.max()))
    return np.array(boxes, np.int64).reshape(-1, 4)


def accuracy(hits: NDArray[np.bool_]) -> float:
    """Share of (P,) queries that hit, 0..1; NaN of none."""
    return float(hits.mean()) if len(hits) else float("nan")

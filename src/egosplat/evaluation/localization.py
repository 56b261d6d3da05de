"""Localization: decide whether an answer hits its target (docs/method.md#scores)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from egosplat.evaluation.queries import InstanceMap, Mask, mask_of

# Regions to hit: the bounding box of an instance, as in LangSplat, or its pixels.
TARGETS = ("box", "mask")


def target_area(instance_map: InstanceMap, instances: Sequence[int], hit_region: str) -> Mask:
    """(H, W) bool pixels that hit any of the instances.

    Args:
        instance_map: (..., H, W) int32.
        hit_region: one of ``TARGETS``.

    Raises:
        ValueError: the hit region is unknown.
    """
    match hit_region:
        case "mask":
            return mask_of(instance_map, instances)
        case "box":
            area = np.zeros(instance_map.shape[-2:], np.bool_)
            for x0, y0, x1, y1 in bounding_boxes(instance_map, instances):
                # The last column and row belong to the box.
                area[y0 : y1 + 1, x0 : x1 + 1] = True
            return area
    raise ValueError(f"hit_region {hit_region!r} is not one of {TARGETS}")


def is_hit(pixel: tuple[int, int] | None, area: Mask) -> bool:
    """Whether a pixel, column and row, lies in the (H, W) area; False without one."""
    return pixel is not None and bool(area[pixel[1], pixel[0]])


def random_hit(area: Mask, valid: Mask | None) -> float:
    """Probability that a random valid pixel hits, 0..1.

    Args:
        area: (H, W) bool, see ``target_area``.
        valid: (H, W) bool pixels that show the scene, at least one; None for all.
    """
    return float((area if valid is None else area[valid]).mean())


def middle_hit(area: Mask) -> bool:
    """Whether the middle pixel of the image, (W // 2, H // 2), hits."""
    height, width = area.shape
    return bool(area[height // 2, width // 2])


def bounding_boxes(instance_map: InstanceMap, instances: Sequence[int]) -> NDArray[np.int64]:
    """Bounding boxes of the visible instances.

    Returns:
        (B, 4) int64 x0, y0, x1, y1: first and last column and row [px], both inside.
    """
    boxes = []
    for instance in instances:
        rows, columns = np.nonzero(mask_of(instance_map, [instance]))
        if len(rows):
            boxes.append((columns.min(), rows.min(), columns.max(), rows.max()))
    return np.array(boxes, np.int64).reshape(-1, 4)

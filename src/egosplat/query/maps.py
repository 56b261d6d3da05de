"""What relevancy maps say: where a query is found, and which pixels show it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.query.localization import Location, localize
from egosplat.query.options import QueryOptions
from egosplat.query.segmentation import Segmentation, segment
from egosplat.query.smoothing import Map, Mask, box_filter, fill_unseen


@dataclass(frozen=True, eq=False)
class Found:
    """Where one query is found in one picture.

    Attributes:
        location: the place of the largest smoothed relevancy.
        segmentation: the mask.
        relevancy: (H, W) float32 at the location's level, not smoothed; 0 where nothing is seen.
    """

    location: Location
    segmentation: Segmentation
    relevancy: Map


def find_in_maps(maps: Map, valid: Mask, options: QueryOptions) -> Found | None:
    """Read a query's maps, one a level, as LangSplat does (docs/method.md#query-levels).

    Args:
        maps: (L, h, w) float32 relevancy in 0..1, NaN where nothing is seen; of the picture resized, with pixel centres
            where they were.
        valid: (H, W) bool pixels of the picture that show the scene; there is no answer elsewhere.
        options: ``smoothing``, ``segmentation_threshold`` and ``majority`` are used.

    Returns:
        None where nothing is seen at any level.

    Raises:
        ValueError: the maps have not three axes.
    """
    if maps.ndim != 3:
        raise ValueError(f"maps {maps.shape} are not (level, height, width)")
    nearest = cv2.INTER_NEAREST_EXACT
    seen = ~np.isnan(maps) & (_resize(valid.astype(np.uint8), maps.shape[1:], nearest) > 0)
    shown = valid & np.stack([_resize(one.astype(np.uint8), valid.shape, nearest) > 0 for one in seen])
    filled = (fill_unseen(*level) for level in zip(maps, seen, strict=True))
    raw = np.stack([_resize(level, valid.shape, cv2.INTER_LINEAR) for level in filled])
    longer = max(valid.shape)
    filtered = np.stack([box_filter(level, options.smoothing_px(longer)) for level in raw])
    location = localize(filtered, shown)
    mask = segment(raw, filtered, shown, options.segmentation_threshold, options.majority_px(longer))
    if location is None or mask is None:
        return None
    relevancy = np.where(shown[location.level], raw[location.level], np.float32(0.0))
    return Found(location, mask, relevancy)


def _resize(values: NDArray, size: tuple[int, int], interpolation: int) -> NDArray:
    """(h, w) -> (H, W) of that size; pixel centres stay where they are in the picture."""
    height, width = size
    return (
        values if values.shape == size else cv2.resize(values, (width, height), interpolation=interpolation)
    )

"""Relevancy maps: where a query is found (docs/method.md#localization) and its mask (#segmentation-threshold)."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.query.options import QueryOptions

Map = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Location:
    """The place of the largest relevancy.

    Attributes:
        level: index of the level at which it is largest, the first of equal ones.
        score: that relevancy, smoothed.
        candidates: (K, 2) int64 column and row of all pixels that have it, K at least 1.
    """

    level: int
    score: float
    candidates: NDArray[np.int64]

    @property
    def pixel(self) -> tuple[int, int]:
        """Column and row of one candidate: that nearest to their middle."""
        apart = np.linalg.norm(self.candidates - self.candidates.mean(axis=0), axis=1)
        column, row = self.candidates[apart.argmin()]
        return int(column), int(row)


@dataclass(frozen=True, eq=False)
class Segmentation:
    """A mask.

    Attributes:
        level: index of the level that it was made at, the first of equal ones.
        mask: (H, W) bool.
    """

    level: int
    mask: Mask


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
        options: ``box_filter``, ``segmentation_threshold`` and ``majority_filter`` are used.

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
    filtered = np.stack([box_filter(level, options.box_filter_px(longer)) for level in raw])
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


def localize(filtered: Map, seen: Mask) -> Location | None:
    """The level with the largest value, and all pixels that have this value.

    Args:
        filtered: (L, H, W) float32 smoothed relevancy, finite.
        seen: (L, H, W) bool; other pixels are no candidates.

    Returns:
        None where nothing is seen at any level.
    """
    if not seen.any():
        return None
    peaks = filtered.max(axis=(1, 2), where=seen, initial=-np.inf)
    level = int(peaks.argmax())
    rows, columns = np.nonzero((filtered[level] == peaks[level]) & seen[level])
    return Location(level, float(peaks[level]), np.stack([columns, rows], axis=1))


def segment(
    raw: Map, filtered: Map, seen: Mask, segmentation_threshold: float, majority_px: int
) -> Segmentation | None:
    """The mask of the level at which the mean of raw and smoothed relevancy is largest.

    This mean is brought to 0..1 over what is seen at the level; what is above the threshold belongs to the mask, which
    then takes the majority of its surroundings. LangSplat's ``clip(2 g - 1, 0, 1) > 0.4`` is ``g > 0.7``. A relative
    threshold finds something for every query, present or not; only a constant map has an empty mask.

    Args:
        raw: (L, H, W) float32 relevancy, finite.
        filtered: the same, smoothed.
        seen: (L, H, W) bool; other pixels do not count and are in no mask.
        segmentation_threshold: see ``QueryOptions``.
        majority_px: see ``majority``.

    Returns:
        None where nothing is seen at any level.
    """
    if not seen.any():
        return None
    combined = (raw + filtered) / 2
    peaks = combined.max(axis=(1, 2), where=seen, initial=-np.inf)
    level = int(peaks.argmax())
    values, top = combined[level], peaks[level]
    lowest = values.min(where=seen[level], initial=np.inf)
    above = (values - lowest > segmentation_threshold * (top - lowest)) & seen[level]
    return Segmentation(level, majority(above, majority_px) & seen[level])


def box_filter(values: Map, size: int) -> Map:
    """Mean over a square around each pixel, the border mirrored without repeating the outermost pixel.

    A square of even side reaches one pixel further to the left and up: of side 30, from -15 to +14. This is OpenCV's
    ``filter2D`` with a constant kernel, by running sums, so that its time does not grow with the size.

    Args:
        values: (H, W) float32, finite.
        size: side of the square [px]; 1 changes nothing.

    Returns:
        (H, W) float32.
    """
    return cv2.blur(values, (size, size), borderType=cv2.BORDER_REFLECT_101)


def majority(mask: Mask, size: int) -> Mask:
    """Where more than half of the square around a pixel is set; squares end at the border (LangSplat's).

    Args:
        mask: (H, W) bool.
        size: side of the square [px], odd; 1 changes nothing.

    Returns:
        (H, W) bool.
    """
    inside, pixels = (
        cv2.boxFilter(
            values.astype(np.float32), -1, (size, size), normalize=False, borderType=cv2.BORDER_CONSTANT
        )
        for values in (mask, np.ones_like(mask))
    )
    return 2 * inside > pixels


def fill_unseen(values: Map, seen: Mask) -> Map:
    """Put the lowest value that is seen wherever nothing is seen.

    Any value below it would stretch the scale that a map is normalised by, and so move the threshold of all masks.

    Args:
        values: (H, W) float32.
        seen: (H, W) bool.

    Returns:
        (H, W) float32; zeros where nothing at all is seen.
    """
    return np.where(seen, values, values[seen].min()) if seen.any() else np.zeros_like(values)

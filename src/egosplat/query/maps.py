"""Read relevancy maps: localization (docs/method.md#localization) and masks (#segmentation-threshold)."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.query.options import QueryOptions

Map = NDArray[np.float32]
Mask = NDArray[np.bool_]


PLATEAU = 1e-4
"""Smoothed relevancies that differ by less are equal: those of Gaussians with one code differ by rounding."""


@dataclass(frozen=True, eq=False)
class Location:
    """The most relevant pixel.

    Attributes:
        level: index of its level; the first one on ties.
        score: the largest smoothed relevancy.
        pixel: column and row; the innermost of the pixels whose smoothed relevancy is as large, within ``PLATEAU``.
    """

    level: int
    score: float
    pixel: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Segmentation:
    """A mask.

    Attributes:
        level: index of its level; the first one on ties.
        mask: (H, W) bool.
    """

    level: int
    mask: Mask


@dataclass(frozen=True, eq=False)
class Found:
    """Location and mask of one query in one image.

    Attributes:
        location: the most relevant pixel, after smoothing.
        segmentation: the mask.
        relevancy: (H, W) float32 at the location's level, not smoothed; 0 where no code is visible.
    """

    location: Location
    segmentation: Segmentation
    relevancy: Map


@dataclass(frozen=True, eq=False)
class Peak:
    """Location of one query in one image, and which relevancy matches it.

    Attributes:
        location: as in ``Found``.
        relevancy: as in ``Found``.
        shown: (H, W) bool pixels with a visible code at the location's level.
        threshold: relevancy above which something at this level belongs to the answer.
    """

    location: Location
    relevancy: Map
    shown: Mask
    threshold: float


def find_in_maps(maps: Map, valid: Mask, options: QueryOptions) -> Found | None:
    """Localize and segment a query from its maps of all levels, as LangSplat does (docs/method.md#query-levels).

    Args:
        maps: (L, h, w) float32 relevancy in 0..1, NaN where no code is visible; of the whole image at any size.
        valid: (H, W) bool pixels of the image that show the scene; other pixels are never answers.
        options: ``box_filter``, ``segmentation_threshold`` and ``majority_filter`` are used.

    Returns:
        None if no level has a visible code.

    Raises:
        ValueError: the maps do not have three axes.
    """
    raw, filtered, shown = _read(maps, valid, options)
    location, side = localize(filtered, shown), options.majority_px(max(valid.shape))
    mask = segment(raw, filtered, shown, options.segmentation_threshold, side)
    if location is None or mask is None:
        return None
    relevancy = np.where(shown[location.level], raw[location.level], np.float32(0.0))
    return Found(location, mask, relevancy)


def find_peak(maps: Map, valid: Mask, options: QueryOptions) -> Peak | None:
    """Localize a query as ``find_in_maps`` does; arguments, ``None`` and errors as there.

    The threshold lies between the least and the largest relevancy of the level as that of ``segment``.
    """
    raw, filtered, shown = _read(maps, valid, options)
    location = localize(filtered, shown)
    if location is None:
        return None
    values, seen = raw[location.level], shown[location.level]
    lowest, top = values[seen].min(), values[seen].max()
    threshold = float(lowest + options.segmentation_threshold * (top - lowest))
    return Peak(location, np.where(seen, values, np.float32(0.0)), seen, threshold)


def _read(maps: Map, valid: Mask, options: QueryOptions) -> tuple[Map, Map, Mask]:
    """(L, H, W) raw and smoothed relevancy, and pixels that may answer, see ``find_in_maps``."""
    if maps.ndim != 3:
        raise ValueError(f"maps {maps.shape} are not (level, height, width)")
    # Not INTER_NEAREST, which does not keep pixel centers in place.
    nearest = cv2.INTER_NEAREST_EXACT
    seen = ~np.isnan(maps) & (_resize(valid.astype(np.uint8), maps.shape[1:], nearest) > 0)
    shown = valid & np.stack([_resize(one.astype(np.uint8), valid.shape, nearest) > 0 for one in seen])
    filled = (fill_unseen(*level) for level in zip(maps, seen, strict=True))
    raw = np.stack([_resize(level, valid.shape, cv2.INTER_LINEAR) for level in filled])
    side = options.box_filter_px(max(valid.shape))
    return raw, np.stack([box_filter(level, side) for level in raw]), shown


def _resize(values: NDArray, size: tuple[int, int], interpolation: int) -> NDArray:
    """Resize (h, w) values to ``size``, (H, W); pixel centers keep their place in the image."""
    height, width = size
    return (
        values if values.shape == size else cv2.resize(values, (width, height), interpolation=interpolation)
    )


def localize(filtered: Map, seen: Mask) -> Location | None:
    """Find the level with the largest value, and the innermost of the pixels with this value.

    Args:
        filtered: (L, H, W) float32 smoothed relevancy, finite.
        seen: (L, H, W) bool pixels that may be found.

    Returns:
        None if ``seen`` is empty.
    """
    if not seen.any():
        return None
    # LangSplat's: the level with the most relevant pixel answers (docs/method.md#query-levels).
    peaks = filtered.max(axis=(1, 2), where=seen, initial=-np.inf)
    level = int(peaks.argmax())
    equal = (filtered[level] >= peaks[level] - PLATEAU) & seen[level]
    return Location(level, float(peaks[level]), innermost(equal))


def innermost(mask: Mask) -> tuple[int, int]:
    """Column and row of the pixel of a mask, (H, W) bool with any pixel, that is farthest from all pixels outside it.

    Of several, the one nearest to their mean. Pixels beyond the image are outside.
    """
    depth = cv2.distanceTransform(np.pad(mask.astype(np.uint8), 1), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    rows, columns = np.nonzero(depth[1:-1, 1:-1] == depth.max())
    # The mean itself may be outside: the deepest pixels need not be connected.
    apart = (rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2
    nearest = apart.argmin()
    return int(columns[nearest]), int(rows[nearest])


def segment(
    raw: Map, filtered: Map, seen: Mask, segmentation_threshold: float, majority_px: int
) -> Segmentation | None:
    """Segment at the level where the mean of raw and smoothed relevancy is largest.

    The mean is normalized to 0..1 over the seen pixels of the level, thresholded, and filtered by ``majority``.

    Args:
        raw: (L, H, W) float32 relevancy, finite.
        filtered: (L, H, W) float32 smoothed relevancy, finite.
        seen: (L, H, W) bool; other pixels are in no mask.
        segmentation_threshold: see ``QueryOptions``.
        majority_px: see ``majority``.

    Returns:
        None if ``seen`` is empty.
    """
    if not seen.any():
        return None
    # LangSplat segments the mean of both, not the smoothed map alone.
    combined = (raw + filtered) / 2
    peaks = combined.max(axis=(1, 2), where=seen, initial=-np.inf)
    level = int(peaks.argmax())
    values, top = combined[level], peaks[level]
    lowest = values.min(where=seen[level], initial=np.inf)
    # LangSplat writes this as clip(2 g - 1, 0, 1) > 0.4, which is g > 0.7. A relative threshold gives every query a
    # mask, whether the object is there or not; only a constant map has an empty one.
    above = (values - lowest > segmentation_threshold * (top - lowest)) & seen[level]
    return Segmentation(level, majority(above, majority_px) & seen[level])


def box_filter(values: Map, size: int) -> Map:
    """Mean over a square around each pixel; the border is mirrored without repeating the outermost pixel.

    A square of even side reaches one pixel further left and up: side 30 covers -15 to +14.

    Args:
        values: (H, W) float32, finite.
        size: side of the square [px]; 1 changes nothing.

    Returns:
        (H, W) float32.
    """
    # Equals LangSplat's filter2D with a constant kernel, but uses running sums: the time does not grow with the size.
    return cv2.blur(values, (size, size), borderType=cv2.BORDER_REFLECT_101)


def majority(mask: Mask, size: int) -> Mask:
    """Majority filter: set a pixel if more than half of the square around it is set (LangSplat).

    Squares are cut off at the border.

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
    # At the border the square has fewer pixels, which ``pixels`` counts.
    return 2 * inside > pixels


def fill_unseen(values: Map, seen: Mask) -> Map:
    """Fill unseen pixels with the lowest seen value.

    Args:
        values: (H, W) float32.
        seen: (H, W) bool.

    Returns:
        (H, W) float32; zeros if no pixel is seen.
    """
    # A lower value would stretch the range that masks are normalized by, and so move their thresholds.
    return np.where(seen, values, values[seen].min()) if seen.any() else np.zeros_like(values)

"""Read relevancy maps: localization (docs/method.md#localization) and masks (#segmentation-threshold)."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.query.options import MapOptions

Map = NDArray[np.float32]
Mask = NDArray[np.bool_]


PLATEAU = 1e-4
"""Smoothed relevancies that differ by less are equal: those of Gaussians with one code differ by rounding."""


@dataclass(frozen=True, eq=False)
class Maps:
    """The relevancy of one query in an image of (H, W) pixels, at L levels.

    Attributes:
        raw, smooth: (L, H, W) float32, finite: before and after the box filter.
        shown: (L, H, W) bool pixels that show the scene and have a code at a level.
    """

    raw: Map
    smooth: Map
    shown: Mask

    def at(self, level: int) -> Map:
        """(H, W) float32 relevancy of a level, not smoothed; 0 where no code is visible."""
        return np.where(self.shown[level], self.raw[level], np.float32(0.0))

    def threshold(self, level: int, share: float) -> float:
        """The relevancy at a share of the way from the least to the largest of a level."""
        seen = self.raw[level][self.shown[level]]
        return float(seen.min() + share * (seen.max() - seen.min()))


def read_maps(maps: Map, valid: Mask, options: MapOptions) -> Maps:
    """Enlarge and smooth a query's maps of all levels (docs/method.md#query-levels).

    Args:
        maps: (L, h, w) float32 relevancy in 0..1, NaN where no code is visible; of the whole image at any size.
        valid: (H, W) bool pixels of the image that show the scene; other pixels are never answers.
        options: ``box_filter`` is used.

    Raises:
        ValueError: the maps do not have three axes.
    """
    if maps.ndim != 3:
        raise ValueError(f"maps {maps.shape} are not (level, height, width)")
    # Not INTER_NEAREST, which does not keep pixel centers in place.
    nearest = cv2.INTER_NEAREST_EXACT
    seen = ~np.isnan(maps) & (_resize(valid.astype(np.uint8), maps.shape[1:], nearest) > 0)
    shown = valid & np.stack([_resize(one.astype(np.uint8), valid.shape, nearest) > 0 for one in seen])
    filled = (fill_unseen(*level) for level in zip(maps, seen, strict=True))
    raw = np.stack([_resize(level, valid.shape, cv2.INTER_LINEAR) for level in filled])
    side = options.box_filter_px(max(valid.shape))
    return Maps(raw, np.stack([box_filter(level, side) for level in raw]), shown)


def _resize(values: NDArray, size: tuple[int, int], interpolation: int) -> NDArray:
    """Resize (h, w) values to ``size``, (H, W); pixel centers keep their place in the image."""
    height, width = size
    return (
        values if values.shape == size else cv2.resize(values, (width, height), interpolation=interpolation)
    )


def localize(smooth: Map, shown: Mask) -> tuple[int, float, tuple[int, int]] | None:
    """Find the level with the largest value (the first one on ties), this value, and the innermost of its pixels.

    Args:
        smooth: (L, H, W) float32 smoothed relevancy, finite.
        shown: (L, H, W) bool pixels that may be found.

    Returns:
        Level, score, and column and row of a pixel, as large within ``PLATEAU``; None if ``shown`` is empty.
    """
    if not shown.any():
        return None
    # LangSplat's: the level with the most relevant pixel answers (docs/method.md#query-levels).
    peaks = smooth.max(axis=(1, 2), where=shown, initial=-np.inf)
    level = int(peaks.argmax())
    equal = (smooth[level] >= peaks[level] - PLATEAU) & shown[level]
    return level, float(peaks[level]), innermost(equal)


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


def segment(maps: Maps, segmentation_threshold: float, majority_px: int) -> tuple[int, Mask]:
    """Segment at the level where the mean of raw and smoothed relevancy is largest; the first one on ties.

    The mean is normalized to 0..1 over the shown pixels of the level, thresholded, and filtered by ``majority``.

    Args:
        maps: some pixel of them is shown.
        segmentation_threshold: see ``QueryOptions``.
        majority_px: see ``majority``.

    Returns:
        The level, and its (H, W) mask.
    """
    # LangSplat segments the mean of both, not the smoothed map alone.
    combined = (maps.raw + maps.smooth) / 2
    peaks = combined.max(axis=(1, 2), where=maps.shown, initial=-np.inf)
    level = int(peaks.argmax())
    values, top, shown = combined[level], peaks[level], maps.shown[level]
    lowest = values.min(where=shown, initial=np.inf)
    # LangSplat writes this as clip(2 g - 1, 0, 1) > 0.4, which is g > 0.7. A relative threshold gives every query a
    # mask, whether the object is there or not; only a constant map has an empty one.
    above = (values - lowest > segmentation_threshold * (top - lowest)) & shown
    return level, majority(above, majority_px) & shown


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

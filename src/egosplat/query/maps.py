"""Read relevancy maps: localization (docs/method.md#localization) and masks (#segmentation-threshold)."""

from dataclasses import dataclass

import cv2
import numpy as np

from egosplat.arrays import Bools, Floats
from egosplat.query.options import QueryOptions

PLATEAU = 1e-4
"""Smoothed relevancies that differ by less are equal: those of Gaussians with one code differ by rounding."""


@dataclass(frozen=True, eq=False)
class Maps:
    """(L, H, W) finite relevancy of one query in an image, at L levels, before and after the box filter; and the pixels that show the
    scene and have a code at a level."""

    raw: Floats
    smooth: Floats
    shown: Bools

    def threshold(self, level: int, share: float) -> float:
        """The relevancy just above a share of the way from the least to the largest of a level."""
        seen = self.raw[level][self.shown[level]]
        # A blend of equal relevancies differs from them by rounding, which must not decide.
        return float(seen.min() + share * (seen.max() - seen.min())) + PLATEAU


def read_maps(maps: Floats, valid: Bools, options: QueryOptions) -> Maps:
    """Enlarge and smooth (L, h, w) float32 relevancy in 0..1 of the whole image at any size, NaN where no code is visible, to
    the (H, W) bool ``valid`` pixels, which show the scene; others are never answers (docs/method.md#query-levels)."""
    height, width = valid.shape
    seen = ~np.isnan(maps) & resize_shown(valid, *maps.shape[1:])
    shown = valid & np.stack([resize_shown(level, height, width) for level in seen])
    raw = np.stack([fill_unseen(*level) for level in zip(maps, seen, strict=True)])
    raw = np.stack([cv2.resize(level, (width, height)).astype(np.float32, copy=False) for level in raw])
    side = options.box_filter_px(max(valid.shape))
    return Maps(raw, np.stack([box_filter(level, side) for level in raw]), shown)


def resize_shown(mask: Bools, height: int, width: int) -> Bools:
    """Sample a mask at the pixel centers of another size, (height, width) bool."""
    # Not INTER_NEAREST, which does not keep pixel centers in place.
    return cv2.resize(mask.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST_EXACT) > 0


def localize(smooth: Floats, shown: Bools) -> tuple[int, float, tuple[int, int]] | None:
    """Find the level with the largest of (L, H, W) float32 values that are ``shown``, the first one on ties; None if none is:
    level, this value, and column and row of the innermost pixel as large within ``PLATEAU``."""
    if not shown.any():
        return None
    # LangSplat's: the level with the most relevant pixel answers (docs/method.md#query-levels).
    peaks = smooth.max(axis=(1, 2), where=shown, initial=-np.inf)
    level = int(peaks.argmax())
    equal = (smooth[level] >= peaks[level] - PLATEAU) & shown[level]
    return level, float(peaks[level]), innermost(equal)


def innermost(mask: Bools) -> tuple[int, int]:
    """Column and row of the pixel of a mask that is farthest from all pixels outside it, and beyond the image; of several, the one
    nearest to their mean."""
    depth = cv2.distanceTransform(np.pad(mask.astype(np.uint8), 1), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    rows, columns = np.nonzero(depth[1:-1, 1:-1] == depth.max())
    # The mean itself may be outside: the deepest pixels need not be connected.
    nearest = ((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2).argmin()
    return int(columns[nearest]), int(rows[nearest])


def segment(maps: Maps, segmentation_threshold: float, majority_px: int) -> tuple[int, Bools]:
    """Segment at the level where the mean of raw and smoothed relevancy is largest; the first one on ties.

    Returns the level, and its (H, W) mask: the mean, normalized to 0..1 over the shown pixels, thresholded, and filtered by ``majority``.
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


def box_filter(values: Floats, size: int) -> Floats:
    """Mean of (H, W) float32 over a square around each pixel, -15 to +14 for a side of 30; the border is mirrored without repeating
    the outermost pixel."""
    # Equals LangSplat's filter2D with a constant kernel, but uses running sums: the time does not grow with the size.
    return cv2.blur(values, (size, size), borderType=cv2.BORDER_REFLECT_101).astype(np.float32, copy=False)


def majority(mask: Bools, size: int) -> Bools:
    """Set a pixel if more than half of the square around it, of odd side and cut off at the border, is set (LangSplat)."""
    how = -1, (size, size), None, (-1, -1), False, cv2.BORDER_CONSTANT
    inside, pixels = (cv2.boxFilter(one.astype(np.float32), *how) for one in (mask, np.ones_like(mask)))
    # At the border the square has fewer pixels, which ``pixels`` counts.
    return 2 * inside > pixels


def fill_unseen(values: Floats, seen: Bools) -> Floats:
    """Fill unseen pixels of (H, W) float32 with the lowest seen value; zeros if no pixel is seen."""
    # A lower value would stretch the range that masks are normalized by, and so move their thresholds.
    return np.where(seen, values, values[seen].min()) if seen.any() else np.zeros_like(values)

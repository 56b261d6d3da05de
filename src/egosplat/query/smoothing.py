"""Neighbourhoods: the box filter of maps, the majority in masks, and what stands where nothing is seen."""

import cv2
import numpy as np
from numpy.typing import NDArray

Map = NDArray[np.float32]
Mask = NDArray[np.bool_]


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

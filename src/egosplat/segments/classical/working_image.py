"""Resize an image to the segmenter's working size, and labels back to the image's size."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class WorkingImage:
    """An image at the working size.

    Attributes:
        rgb: (h, w, 3) float32 in [0, 1]; invalid pixels have the color of the nearest valid one.
        valid: (h, w) bool, pixels that are valid at least in part.
        shape: height and width of the original image.
        unit: working pixels per pixel at the nominal side, at most 1.
    """

    rgb: NDArray[np.float32]
    valid: NDArray[np.bool_]
    shape: tuple[int, int]
    unit: float


def resize_to_side(image: NDArray[np.uint8], valid: NDArray[np.bool_], side: int) -> WorkingImage:
    """Reduce an (H, W, 3) uint8 image to at most ``side`` px; pixels outside of (H, W) ``valid`` have no influence."""
    height, width = valid.shape
    scale = min(1.0, side / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    weight = cv2.resize(valid.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    kept = np.where(valid[..., None], image, 0).astype(np.float32) / 255
    rgb = cv2.resize(kept, size, interpolation=cv2.INTER_AREA)
    some = weight > 1e-6
    rgb /= np.where(some, weight, 1)[..., None]  # the mean over valid pixels only
    return WorkingImage(fill(rgb, some), some, (height, width), max(size) / side)


def fill(values: NDArray[np.generic], known: NDArray[np.bool_]) -> NDArray[np.generic]:
    """Fill (h, w, ...) values outside of (h, w) bool ``known`` with those of the nearest known pixel."""
    if known.all() or not known.any():
        return values
    _, nearest = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    by_number = np.zeros((nearest.max() + 1, *values.shape[2:]), dtype=values.dtype)
    by_number[nearest[known]] = values[known]
    return by_number[nearest]

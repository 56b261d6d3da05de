"""Images: resize them, encode them for pages, and choose a few of many."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# Largest width and height of a WebP file [px].
LARGEST = 16383


def shrunk_size(width: int, height: int, longest: int | None) -> tuple[int, int]:
    """Return width and height in the same proportion, the longer one at most ``longest``; as they are for None."""
    scale = 1.0 if longest is None else min(1.0, longest / max(width, height))
    return max(1, round(width * scale)), max(1, round(height * scale))


def resize_image(image: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    """(h, w, 3) uint8 -> (height, width, 3) uint8, averaged over the area of each new pixel; the same array if nothing changes."""
    if image.shape[:2] == (height, width):
        return image
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), image.dtype)


def shrink_image(image: NDArray[np.uint8], longest: int | None) -> NDArray[np.uint8]:
    """(h, w, 3) uint8 -> the same image in the size of ``shrunk_size``."""
    height, width = image.shape[:2]
    return resize_image(image, *shrunk_size(width, height, longest))


def resize_mask(mask: NDArray[np.bool_], width: int, height: int) -> NDArray[np.bool_]:
    """(h, w) bool -> (height, width) bool: True where the whole area of the new pixel is in the mask."""
    coverage = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    # 1 up to float32 rounding.
    return coverage > 1 - 1e-4


def resize_labels(labels: NDArray[Any], width: int, height: int) -> NDArray[Any]:
    """(..., h, w) -> (..., height, width): the label under the center of each new pixel."""
    # The source pixel of center i + 1/2 in integer arithmetic, without rounding.
    rows = (2 * np.arange(height) + 1) * labels.shape[-2] // (2 * height)
    columns = (2 * np.arange(width) + 1) * labels.shape[-1] // (2 * width)
    return labels[..., rows[:, None], columns]


def encode_webp(image: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """(h, w, 3) uint8 RGB, at most ``LARGEST`` px wide and high -> (n,) uint8, the bytes of a WebP file."""
    return cv2.imencode(".webp", image[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, quality])[1].reshape(-1)


def evenly_spaced(count: int, most: int) -> list[int]:
    """At most ``most`` indices below ``count``, evenly spaced from the first to the last."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist()

"""Reduce frames to the working size, at which H and the temporary Gaussians are trained."""

import cv2
import numpy as np
from numpy.typing import NDArray


def working_size(height: int, width: int, resolution: int | None) -> tuple[int, int]:
    """Return height and width scaled down so that the longer side is at most ``resolution``; as they are for None."""
    if resolution is None:
        return height, width
    factor = min(resolution / max(height, width), 1.0)
    return max(round(height * factor), 1), max(round(width * factor), 1)


def reduced(picture: NDArray[np.uint8], height: int, width: int) -> NDArray[np.uint8]:
    """Downscale (h, w) or (h, w, 3) to ``height`` and ``width`` by area averaging."""
    if picture.shape[:2] == (height, width):
        return picture
    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)

"""Making pictures, masks and label maps smaller."""

import cv2
import numpy as np
from numpy.typing import NDArray


def resize_picture(picture: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    """(h, w, 3) uint8 -> (height, width, 3) uint8, averaging over the area of each new pixel."""
    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)


def resize_mask(mask: NDArray[np.bool_], width: int, height: int) -> NDArray[np.bool_]:
    """(h, w) bool -> (height, width) bool: new pixels whose whole area is inside the mask."""
    share = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    return share > 1 - 1e-4


def resize_labels(labels: NDArray[np.generic], width: int, height: int) -> NDArray[np.generic]:
    """(h, w) -> (height, width): each new pixel takes the label under its centre."""
    rows = (2 * np.arange(height) + 1) * labels.shape[0] // (2 * height)
    columns = (2 * np.arange(width) + 1) * labels.shape[1] // (2 * width)
    return labels[rows[:, None], columns]

"""Sharpness of frames, and detection of blurred and blank ones."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

# Measured on photographs of 512 px: a Gaussian blur of 1 px leaves 0.10 to 0.14 of the median sharpness, of 0.5 px
# it leaves 0.5. The least sharp frame of a synthetic apartment and of two photo series has 0.59.
# A frame below this fraction of the recording's median sharpness counts as blurred.
BLURRED = 0.25


def sharpness(image: NDArray[np.uint8], valid: NDArray[np.bool_]) -> float:
    """Variance of the Laplacian of the grey image over valid pixels; 0 if there is none.

    Args:
        image: (H, W, 3) uint8 RGB.
        valid: (H, W) bool: pixels that show the scene.
    """
    # Erosion drops pixels whose Laplacian includes an invalid neighbour.
    inside = cv2.erode(valid.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    laplacian = cv2.Laplacian(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.CV_64F)[inside]
    return float(laplacian.var()) if len(laplacian) else 0.0


def count_blurred(values: Sequence[float]) -> int:
    """Number of blurred or blank frames, from the ``sharpness`` of every frame of a recording."""
    limit = BLURRED * float(np.median(values))
    # A sharpness of 0 is blank even if the median is 0.
    return sum(value < limit or value == 0.0 for value in values)

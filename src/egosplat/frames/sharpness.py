"""How sharp pictures are, against the others of their recording: blurred and blank ones stand out."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

BLURRED = 0.25
"""Share of the median sharpness of a recording below which a picture is blurred or blank. Of photographs of 512 px, a
Gaussian blur of 1 px leaves 0.10 to 0.14, of half a pixel 0.5; the least sharp of a synthetic apartment and of two series of
photographs have 0.59."""


def sharpness(picture: NDArray[np.uint8], valid: NDArray[np.bool_]) -> float:
    """Variance of the Laplacian of the grey picture, of pixels whose neighbours are valid, too; 0 without any.

    Args:
        picture: (H, W, 3) uint8 RGB; valid: (H, W) pixels that show the scene.
    """
    inside = cv2.erode(valid.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    edges = cv2.Laplacian(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), cv2.CV_64F)[inside]
    return float(edges.var()) if len(edges) else 0.0


def blurred(sharp: Sequence[float]) -> int:
    """How many pictures of a recording are blurred or blank; all of them where most have no edge at all."""
    limit = BLURRED * float(np.median(sharp))
    return sum(one < limit or one == 0.0 for one in sharp)

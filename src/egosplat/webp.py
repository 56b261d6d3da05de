"""Encode images for pages."""

import cv2
import numpy as np
from numpy.typing import NDArray

# Largest width and height that the format holds [px].
LARGEST = 16383


def encode_webp(image: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """(h, w, 3) uint8 RGB, at most ``LARGEST`` px wide and high -> (n,) uint8, the bytes of a WebP file."""
    _, file = cv2.imencode(".webp", image[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, quality])
    return file.reshape(-1)

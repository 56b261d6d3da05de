"""Dense optical flow between two images, and the pixels where it is reliable."""

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.arrays import Bools, Bytes, Floats, Reals

# DIS flow needs images of at least this side [px].
_MIN_SIDE = 32

# Tolerated forward-backward error as a fraction of the flow's length (Sundaram et al. 2010).
_RELATIVE_ERROR = 0.1


def pixel_grid(height: int, width: int) -> Floats:
    """(height, width, 2) float32 x and y of each pixel, with pixel centers at integers as in OpenCV."""
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=2).astype(np.float32)


def sample(image: NDArray, places: Reals) -> NDArray:
    """The image at (h, w, 2) places [px, pixel centers at integers as in OpenCV]; beyond the border, that of the border."""
    x, y = cv2.split(places.astype(np.float32))
    return cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def find_flow(source: Bytes, target: Bytes) -> Floats:
    """Motion of each pixel of ``source`` to ``target``, (h, w) uint8, by dense inverse search (Kroeger et al. 2016).

    Returns:
        (h, w, 2) float32, to the right and down [px].
    """
    height, width = source.shape
    missing = (0, max(0, _MIN_SIDE - height)), (0, max(0, _MIN_SIDE - width))
    # A used search would start from the flow of the previous images.
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    first, second = (np.pad(image, missing, mode="edge") for image in (source, target))
    # A flow of the images' size would be where the search starts; none is given.
    flow = search.calc(first, second, np.empty((1, 1, 2), np.float32))
    return np.asarray(flow, np.float32)[:height, :width]


def is_consistent(flow: Floats, reverse: Floats, tolerance: float) -> Bools:
    """(h, w) bool forward-backward check: following a pixel to the other image and back ends where it began.

    ``flow`` and ``reverse`` are (h, w, 2) [px]; ``tolerance`` [px] is in addition to a tenth of the flow's length.
    """
    returned = sample(reverse, pixel_grid(*flow.shape[:2]) + flow)
    error = np.linalg.norm(flow + returned, axis=2)
    length = np.maximum(np.linalg.norm(flow, axis=2), np.linalg.norm(returned, axis=2))
    return error <= tolerance + _RELATIVE_ERROR * length

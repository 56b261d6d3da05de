"""Dense optical flow between two pictures, and where it can be believed."""

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

_LEAST_SIDE = 32
"""Of the pictures that flow is computed of [px]: smaller ones are continued to the right and below."""

_RELATIVE_ERROR = 0.1
"""By which forward and backward flow may miss each other, as a share of their length."""


def pixel_grid(height: int, width: int) -> Floats:
    """(height, width, 2) float32 x and y of each pixel, whose centre is at the integer as OpenCV has it."""
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=2).astype(np.float32)


def padded(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(h, w) -> the same continued to the right and below to the least side that flow is found of."""
    height, width = picture.shape
    missing = max(0, _LEAST_SIDE - height), max(0, _LEAST_SIDE - width)
    return np.pad(picture, ((0, missing[0]), (0, missing[1])), mode="edge")


def find_flow(source: NDArray[np.uint8], target: NDArray[np.uint8]) -> Floats:
    """(h, w, 2) float32: what each pixel of ``source`` moves by, to the right and down, in ``target`` [px].

    Dense inverse search (Kroeger et al. 2016).

    Args:
        source, target: (h, w) uint8, at least 32 pixels a side.
    """
    # A new search each time: a used one would begin from the flow of the pictures before.
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    return search.calc(source, target, None)


def agree(backward: Floats, forward: Floats, tolerance: float) -> NDArray[np.bool_]:
    """(h, w): following a pixel back and forth ends where it began (Sundaram et al. 2010).

    Args:
        backward, forward: (h, w, 2) flow to the other picture and from there [px].
        tolerance: by which they may miss each other, beside a tenth of their length [px].
    """
    height, width = backward.shape[:2]
    ends = pixel_grid(height, width) + backward
    returned = cv2.remap(forward, ends, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    missed = np.linalg.norm(backward + returned, axis=2)
    length = np.maximum(np.linalg.norm(backward, axis=2), np.linalg.norm(returned, axis=2))
    return missed <= tolerance + _RELATIVE_ERROR * length

"""What moves between two pictures: optical flow against what the known poses allow."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import Array
from egosplat.optical_flow import agree, find_flow, padded, pixel_grid
from egosplat.survey.epipolar import epipole, longest_flow, miss_distance, rotation_homography

Bools = NDArray[np.bool_]
Floats = NDArray[np.float32]
Grey = NDArray[np.uint8]

_TOLERANCE = 1.5
"""By which a static pixel may miss its epipolar line at the working size [px], beside a tenth of its flow's length."""
_RELATIVE = 0.1
_DISAGREEMENT = 1.0
"""By which flow forwards and backwards may miss each other [px]."""
_MARGIN = 8
"""Of what both pictures show, in which flow is not believed [px]."""
_BETTER = 6.0
"""By which a pixel must look more like where flow leads than like anything on its line [grey levels]."""
_STEP, _STEPS = 1.5, 64
"""How finely the line is looked along [px], and in how many steps at most."""
_PATCH = 7
"""Side of the surroundings that are compared [px]."""
_WIDTH, _AREA = 7, 0.0015
"""What is narrower [px], or smaller as a share of the picture, is a speck."""
_BLANK = 128


@dataclass(frozen=True, eq=False)
class Moved:
    """What a pair of pictures shows, (h, w) bool each: where flow is believed, and where it breaks the poses."""

    measured: Bools
    moving: Bools


def find_moving(
    first: Grey, second: Grey, valid: Bools, matrix: Array, poses: tuple[Array, Array], least_depth: float
) -> Moved:
    """What moves from one picture to the next.

    A pixel moves where flow leads away from its epipolar line, and its surroundings look more like what they are led to
    than like anything that the line passes: the second alone tells a thing that moves from a match gone astray in a
    repeating texture.

    Args:
        first, second: (h, w) uint8.
        valid: (h, w) bool, of both.
        matrix: (3, 3) intrinsic matrix [px].
        poses: (4, 4) camera_to_world of each.
        least_depth: of anything static, more than 0 [m].
    """
    turn = rotation_homography(matrix, *poses)
    turned = _turned(second, turn)
    both = valid & (_turned(valid.astype(np.uint8), turn) > 0)
    # What only one of them shows is blank in both: an edge that does not move.
    first, turned = (np.where(both, one, np.uint8(_BLANK)) for one in (first, turned))
    forward, backward = _flow(first, turned), _flow(turned, first)
    measured = agree(forward, backward, _DISAGREEMENT) & _inner(both)
    pixels, towards = pixel_grid(*first.shape) + 0.5, epipole(matrix, *poses)
    tolerance = _TOLERANCE + _RELATIVE * np.linalg.norm(forward, axis=2)
    astray = measured & (miss_distance(pixels, forward, towards, least_depth) > tolerance)
    if blobs(astray).any():
        span = longest_flow(pixels, towards, least_depth)
        astray &= _unlike(first, turned, forward) + _BETTER < _least_unlike(first, turned, span)
    return Moved(measured, blobs(astray))


def blobs(mask: Bools) -> Bools:
    """(h, w) the parts of a mask that are wide and large enough to be a thing."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_WIDTH, _WIDTH))
    wide = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    _, labels, facts, _ = cv2.connectedComponentsWithStats(wide)
    large = facts[:, cv2.CC_STAT_AREA] >= _AREA * mask.size
    large[0] = False  # the ground
    return large[labels]


def _flow(source: Grey, target: Grey) -> Floats:
    height, width = source.shape
    return find_flow(padded(source), padded(target))[:height, :width]


def _turned(picture: Grey, turn: Array) -> Grey:
    """A picture as a camera turned otherwise shows it; 0 where it shows nothing."""
    height, width = picture.shape
    # Pixel centres are at + 0.5 in the package and at whole numbers in OpenCV.
    shift = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpPerspective(picture, np.linalg.inv(shift) @ turn @ shift, (width, height), flags=flags)


def _inner(mask: Bools) -> Bools:
    """(h, w) without its margin; beyond the picture's edge there is nothing."""
    framed = np.pad(mask, 1).astype(np.uint8)
    return cv2.distanceTransform(framed, cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1] > _MARGIN


def _least_unlike(first: Grey, second: Grey, span: Array) -> Floats:
    """(h, w) how unlike at least pixels are to what static points at any depth show there."""
    steps = min(_STEPS, 1 + math.ceil(np.linalg.norm(span, axis=-1).max() / _STEP))
    least = np.full(first.shape, np.inf, np.float32)
    for share in np.linspace(0.0, 1.0, steps + 1):
        np.minimum(least, _unlike(first, second, share * span), out=least)
    return least


def _unlike(first: Grey, second: Grey, flow: NDArray[np.floating]) -> Floats:
    """(h, w) mean absolute difference of pixels' surroundings to those where they move [grey levels]."""
    ends = (pixel_grid(*first.shape) + flow).astype(np.float32)
    there = cv2.remap(second, ends, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return cv2.blur(cv2.absdiff(first, there).astype(np.float32), (_PATCH, _PATCH))

"""Find where the pixels of an image were in the previous image, by optical flow and the camera's motion."""

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.optical_flow import find_flow, is_consistent, pixel_grid, sample
from egosplat.segments.classical.partition import LIGHTNESS_WEIGHT, Bools, WorkingImage

Floats = NDArray[np.float32]
Gray = NDArray[np.uint8]

# Largest gap between forward and backward flow at the nominal side [px], besides a tenth of their length.
_FLOW_ERROR = 8.0
# Largest color change of a pixel between frames [CIELAB], after smoothing with a Gaussian of this sigma [px].
_COLOR_ERROR, _SURROUNDINGS = 15.0, 2.0
# ORB: smallest side of images [px], as its pyramid fails in tiny ones; numbers of features and of matches.
_LEAST_SIDE, _FEATURES, _FAST_THRESHOLD, _LEAST_MATCHES = 64, 1500, 7, 12
# Homography: RANSAC's tolerance as a share of the longer side, and the share of the matches that must agree. Loose,
# because near objects move more than walls.
_TOLERANCE, _LEAST_INLIERS, _SEED = 0.015, 0.2, 1


def find_origins(
    previous: WorkingImage, current: WorkingImage
) -> tuple[NDArray[np.int64], NDArray[np.int64], Bools]:
    """Trace every pixel back by dense inverse search (Kroeger et al. 2016), with a forward-backward check.

    Returns:
        (H, W) int64 row and column of each pixel in the previous image, and (H, W) bool: whether that is known. Pixels
        that do not show the scene have no influence and are no origins.
    """
    height, width = current.shown.shape
    # CIELAB lightness, 0 to 100, as uint8: optical flow needs one 8-bit channel.
    earlier, now = (np.rint(one.lab[..., 0] * 2.55).astype(np.uint8) for one in (previous, current))
    motion = _camera_motion(now, earlier)
    backward, forward = _flow(now, earlier, motion), _flow(earlier, now, np.linalg.inv(motion))
    shape = previous.valid.shape
    agrees = is_consistent(backward, forward, _FLOW_ERROR * previous.unit)
    agrees &= _look_alike(previous, current, backward)
    scale = np.array([width / shape[1], height / shape[0]], dtype=np.float32)
    if (height, width) != shape:
        backward = cv2.resize(backward, (width, height), interpolation=cv2.INTER_LINEAR)
        agrees = cv2.resize(agrees.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0
    rows, columns = np.indices((height, width))
    rows = np.rint(rows + backward[..., 1] * scale[1]).astype(np.int64)
    columns = np.rint(columns + backward[..., 0] * scale[0]).astype(np.int64)
    within = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    rows, columns = rows.clip(0, height - 1), columns.clip(0, width - 1)
    return rows, columns, agrees & within & current.shown & previous.shown[rows, columns]


def _look_alike(before: WorkingImage, now: WorkingImage, backward: Floats) -> Bools:
    """(h, w) bool: a pixel's neighborhood has the color of the neighborhood at its origin."""
    warped = sample(before.lab, pixel_grid(*now.valid.shape) + backward)
    apart = cv2.GaussianBlur(now.lab - warped, (0, 0), _SURROUNDINGS * now.unit)
    apart[..., 0] *= LIGHTNESS_WEIGHT
    return np.linalg.norm(apart, axis=2) <= _COLOR_ERROR


def _flow(source: Gray, target: Gray, motion: NDArray[np.float64]) -> Floats:
    """(h, w, 2) float32 displacement (x, y) of each pixel of ``source`` in ``target`` [px]."""
    # Remove the camera's motion, a homography, first: a turning head moves pixels further than the search
    # finds among repeating textures.
    start = pixel_grid(*source.shape)
    target = sample(target, cv2.perspectiveTransform(start, motion))
    return cv2.perspectiveTransform(start + find_flow(source, target), motion) - start


def _camera_motion(source: Gray, target: Gray) -> NDArray[np.float64]:
    """(3, 3) homography from pixels (x, y) of one (h, w) image to another; the identity if none is found."""
    if min(source.shape) < _LEAST_SIDE:
        return np.eye(3)
    finder = cv2.ORB_create(_FEATURES, fastThreshold=_FAST_THRESHOLD)
    (here, here_codes), (there, there_codes) = (
        finder.detectAndCompute(one, None) for one in (source, target)
    )
    if min(len(here), len(there)) < _LEAST_MATCHES:
        return np.eye(3)
    matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(here_codes, there_codes)
    if len(matches) < _LEAST_MATCHES:
        return np.eye(3)
    begin = np.array([here[one.queryIdx].pt for one in matches], dtype=np.float32)
    end = np.array([there[one.trainIdx].pt for one in matches], dtype=np.float32)
    cv2.setRNGSeed(_SEED)  # RANSAC draws from OpenCV's global generator
    found, inliers = cv2.findHomography(begin, end, cv2.RANSAC, _TOLERANCE * max(source.shape))
    if found is None or inliers.mean() < _LEAST_INLIERS:
        return np.eye(3)
    height, width = source.shape
    corners = np.array([[[0, 0], [width, 0], [width, height], [0, height]]], dtype=np.float32)
    ahead = (np.dstack([corners, np.ones((1, 4, 1))]) @ found[2] > 0).all()
    moved = cv2.perspectiveTransform(corners, found)
    near = np.linalg.norm(moved - corners, axis=2).max() < max(source.shape)
    in_order = cv2.isContourConvex(moved) and cv2.contourArea(moved, oriented=True) > 0
    return found if ahead and near and in_order else np.eye(3)

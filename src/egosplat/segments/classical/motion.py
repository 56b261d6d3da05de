"""Estimate the camera's motion between two images as one homography."""

import cv2
import numpy as np
from numpy.typing import NDArray

_LEAST_SIDE = 64
"""Smallest side of images in which features are detected [px]; ORB's pyramid fails in tiny images."""
_FEATURES = 1500
_FAST_THRESHOLD = 7
_LEAST_MATCHES = 12
_LEAST_INLIERS = 0.2
"""Share of the matches that must agree with the homography."""
_TOLERANCE = 0.015
"""RANSAC's tolerance, as a share of the longer side. Loose, because near objects move more than walls."""
_SEED = 1


def find_motion(source: NDArray[np.uint8], target: NDArray[np.uint8]) -> NDArray[np.float64]:
    """(3, 3) homography from pixels (x, y) of ``source`` to ``target``; the identity if none is found.

    Args:
        source, target: (h, w) uint8.
    """
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
    if found is None or inliers.mean() < _LEAST_INLIERS or not _is_plausible(found, source.shape):
        return np.eye(3)
    return found


def _is_plausible(motion: NDArray[np.float64], shape: tuple[int, int]) -> bool:
    """Whether the image's corners stay in front of the camera, in order, and move by less than one side."""
    height, width = shape
    corners = np.array([[[0, 0], [width, 0], [width, height], [0, height]]], dtype=np.float32)
    depth = np.dstack([corners, np.ones((1, 4, 1))]) @ motion[2]
    moved = move(corners, motion)
    apart = np.linalg.norm(moved - corners, axis=2)
    return bool(
        (depth > 0).all() and apart.max() < max(shape) and cv2.isContourConvex(moved) and _turn(moved) > 0
    )


def _turn(corners: NDArray[np.float32]) -> float:
    """Signed area of a (1, 4, 2) quadrilateral."""
    return cv2.contourArea(corners, oriented=True)


def move(points: NDArray[np.float32], motion: NDArray[np.float64]) -> NDArray[np.float32]:
    """Apply a homography to (h, w, 2) float32 points (x, y)."""
    return cv2.perspectiveTransform(points, motion)

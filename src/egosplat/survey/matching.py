"""Match two images of one scene: brightness made equal, optical flow, and where that flow can be trusted."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import Array
from egosplat.optical_flow import find_flow, is_consistent, pixel_grid, sample
from egosplat.survey.brightness import Bools, Gray, Light, compare_light, equalize
from egosplat.survey.rigid import rotation_homography

Floats = NDArray[np.float32]

# Tolerated forward-backward error [px].
_MAX_FLOW_ERROR = 0.5
# Flow is unreliable within this distance of the border of the common view [px].
_MARGIN = 8
# Side of the patches that are compared [px].
PATCH = 7
# The noise of the images is the difference of matched patches where they match best: without texture, nothing else remains.
_BEST = 0.2
# Its smallest value, from rounding [gray levels].
_MIN_NOISE = 0.5
_BLANK = 128


@dataclass(frozen=True, eq=False)
class Match:
    """Two images of (h, w) pixels, the second rotated to the orientation of the first.

    Attributes:
        first, second: uint8; the second has the brightness of the first.
        flow: (h, w, 2) float32 from the first to the second [px].
        measured: bool, pixels whose flow is reliable.
        flow_error: float32 expected error of flow, from texture and noise; inf without texture [px].
        noise: difference of the fifth of the patches that match best [gray levels].
        light: of surfaces in both; None if too few are measured.
    """

    first: Gray
    second: Gray
    flow: Floats
    measured: Bools
    flow_error: Floats
    noise: float
    light: Light | None


def match_images(
    first: Gray,
    second: Gray,
    valid: Bools,
    intrinsics: Array,
    poses: tuple[Array, Array],
    second_valid: Bools,
) -> Match:
    """Match two (h, w) uint8 images, of which (h, w) bool pixels are valid each.

    Args:
        intrinsics: (3, 3) matrix [px].
        poses: (4, 4) camera_to_world of each.
    """
    homography = rotation_homography(intrinsics, *poses)
    rotated = _warp(second, homography)
    ahead = (pixel_grid(*valid.shape) * homography[2, :2]).sum(axis=2) + homography[2, 2] > 0
    common = valid & ahead & (_warp(second_valid.astype(np.uint8), homography) > 0)
    # The border of the common view is blanked in both images, so that it is an edge without motion.
    first = np.where(common, first, np.uint8(_BLANK))
    aligned = np.where(common, equalize(rotated, first[common], rotated[common]), np.uint8(_BLANK))
    forward, backward = find_flow(first, aligned), find_flow(aligned, first)
    consistent = is_consistent(forward, backward, _MAX_FLOW_ERROR)
    measured = consistent & _eroded(common, _MARGIN)
    # Now that surfaces are matched, their brightness is compared without what only one image shows.
    matched = move(rotated, forward)
    light = compare_light(first, matched, measured, _radii(forward, homography))
    aligned = np.where(common, equalize(rotated, first[measured], matched[measured]), np.uint8(_BLANK))
    difference = mean_of_patch(cv2.absdiff(first, move(aligned, forward)))
    noise = max(_MIN_NOISE, float(np.quantile(difference[measured], _BEST))) if measured.any() else _MIN_NOISE
    structure = np.minimum(texture(first), move(texture(aligned), forward))
    error = noise / (PATCH * np.sqrt(np.maximum(structure, 1e-12)))
    return Match(first, aligned, forward, measured, error, noise, light)


def texture(image: Gray) -> Floats:
    """(h, w) float32 squared gradient of each pixel's patch in its weakest direction [gray levels squared / px squared]."""
    across, down = (cv2.Scharr(image, cv2.CV_32F, *order, scale=1 / 32) for order in ((1, 0), (0, 1)))
    xx, yy, xy = (
        cv2.blur(product, (PATCH, PATCH)) for product in (across * across, down * down, across * down)
    )
    return np.maximum((xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy * xy), 0.0)


def mean_of_patch(image: NDArray) -> Floats:
    """(h, w) float32 mean over each pixel's patch."""
    return cv2.blur(image.astype(np.float32), (PATCH, PATCH))


def move(image: NDArray, flow: NDArray[np.floating]) -> NDArray:
    """(h, w) image at the targets of (h, w, 2) flow."""
    return sample(image, pixel_grid(*image.shape) + flow)


def _warp(image: Gray, homography: Array) -> Gray:
    """Sample an image at the pixels that a homography maps to; 0 outside."""
    height, width = image.shape
    # Pixel centers are at + 0.5 in the package and at integers in OpenCV.
    shift = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpPerspective(image, np.linalg.inv(shift) @ homography @ shift, (width, height), flags=flags)


def _radii(flow: Floats, homography: Array) -> tuple[Array, Array]:
    """(h, w) distance from the center of each pixel, and of its target in the second image's own orientation."""
    height, width = flow.shape[:2]
    pixels, half = pixel_grid(height, width) + 0.5, max(height, width) / 2
    targets = cv2.perspectiveTransform((pixels + flow).astype(np.float64), homography)
    center = np.array([width / 2, height / 2])
    # A pixel that is measured is in view; elsewhere the homography may send it anywhere.
    return tuple(
        np.linalg.norm(np.clip(one, -width, 2 * width) - center, axis=2) / half for one in (pixels, targets)
    )


def _eroded(mask: Bools, margin: float) -> Bools:
    """(h, w) bool: the mask without the pixels near its border."""
    # Padding makes the border of the image a border of the mask.
    framed = np.pad(mask, 1).astype(np.uint8)
    return cv2.distanceTransform(framed, cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1] > margin

"""Compare two images of one scene: their optical flow, their light, and what moves between them."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.arrays import Array, Bools, Bytes, Floats, Ints32
from egosplat.moving_regions import large_regions
from egosplat.optical_flow import find_flow, is_consistent, pixel_grid, sample
from egosplat.survey import rigid
from egosplat.survey.brightness import compare_light, equalize

# Tolerated forward-backward error [px].
_MAX_FLOW_ERROR = 0.5
# Flow is unreliable within this distance of the border of the common view [px].
_MARGIN = 8
# Side of the patches that are compared [px].
_PATCH = 7
# The noise of the images is the difference of matched patches where they match best: without texture, nothing else remains.
_BEST = 0.2
# Its smallest value, from rounding [gray levels].
_MIN_NOISE = 0.5
_BLANK = np.uint8(128)
# A pair with fewer voting pixels, as a fraction of the valid ones, is not judged: neither its correction nor its noise is known.
_MIN_PAIR_VOTING = 0.05
# A pair whose flow disagrees more with itself after correction is not judged [px].
_MAX_NOISE_PX = 1.5
# Pixels with a larger expected error of their flow do not vote [px].
_MAX_EXPECTED_ERROR = 0.3
# A moving pixel's flow leaves the static positions by this many standard deviations.
_DEVIATIONS = 5.0
# The noise of flow grows with its length: it doubles at this length [px].
_DOUBLING = 10.0
# At every static position, a moving pixel's patch differs by this factor more than at the target of its flow, and by this
# many times the noise of the images.
_MIN_RATIO, _MIN_GAIN = 1.5, 1.0
# Spacing of the positions tried along the epipolar segment [px], and their maximum number.
_STEP, _STEPS = 1.5, 64


class Match:
    """Two images of (h, w) pixels, the second rotated to the orientation of the first.

    Attributes:
        first, second: uint8; the second has the brightness of the first.
        flow: (h, w, 2) float32 from the first to the second [px].
        homography: (3, 3) from there to the second image's own orientation.
        measured: bool, pixels whose flow is reliable.
        flow_error: expected error of flow, from texture and noise; inf without texture [px].
        noise: difference of the fifth of the patches that match best [gray levels].
        light: of surfaces in both; None if too few are measured.
    """

    def __init__(
        self,
        first: Bytes,
        second: Bytes,
        valid: Bools,
        intrinsics: Array,
        poses: tuple[Array, Array],
        second_valid: Bools,
    ) -> None:
        """Match two (h, w) uint8 images, of which (h, w) bool pixels are valid, with (4, 4) poses and (3, 3) intrinsics [px]."""
        homography = rigid.rotation_homography(intrinsics, *poses)
        rotated = _warp(second, homography)
        ahead = (pixel_grid(*valid.shape) * homography[2, :2]).sum(axis=2) + homography[2, 2] > 0
        common = valid & ahead & (_warp(second_valid.astype(np.uint8), homography) > 0)
        # The border of the common view is blanked in both images, so that it is an edge without motion.
        first = np.where(common, first, _BLANK)
        aligned = np.where(common, equalize(rotated, first[common], rotated[common]), _BLANK)
        forward, backward = find_flow(first, aligned), find_flow(aligned, first)
        # Padding makes the border of the image a border of the common view.
        inner = cv2.distanceTransform(np.pad(common, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
        measured = is_consistent(forward, backward, _MAX_FLOW_ERROR) & (inner[1:-1, 1:-1] > _MARGIN)
        # Now that surfaces are matched, their brightness is compared without what only one image shows.
        targets = pixel_grid(*valid.shape) + forward
        matched = sample(rotated, targets)
        light = compare_light(first, matched, measured, _radii(forward, homography))
        aligned = np.where(common, equalize(rotated, first[measured], matched[measured]), _BLANK)
        difference = _mean_of_patch(cv2.absdiff(first, sample(aligned, targets)))
        noise = (
            max(_MIN_NOISE, float(np.quantile(difference[measured], _BEST))) if measured.any() else _MIN_NOISE
        )
        structure = np.minimum(_texture(first), sample(_texture(aligned), targets))
        error = noise / (_PATCH * np.sqrt(np.maximum(structure, 1e-12)))
        self.first, self.second, self.flow, self.homography = first, aligned, forward, homography
        self.measured, self.flow_error, self.noise, self.light = measured, error, noise, light


@dataclass(frozen=True, eq=False)
class PairMotion:
    """What two images show.

    Attributes:
        regions: (h, w) int32, regions of the first image that move, numbered from 1; 0 elsewhere.
        voting: number of pixels that could show motion.
        noise_px, before_px: standard deviation of flow around static positions with and without the correction of the
            pose [px]; NaN if not judged.
    """

    regions: Ints32
    voting: int
    noise_px: float
    before_px: float


def _texture(image: Bytes) -> Floats:
    """(h, w) float32 squared gradient of each pixel's patch in its weakest direction [gray levels squared / px squared]."""
    across, down = (cv2.Scharr(image, cv2.CV_32F, *order, scale=1 / 32) for order in ((1, 0), (0, 1)))
    xx, yy, xy = (
        cv2.blur(product, (_PATCH, _PATCH)) for product in (across * across, down * down, across * down)
    )
    return np.maximum((xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy * xy), 0.0)


def _mean_of_patch(image: NDArray) -> Floats:
    """(h, w) float32 mean over each pixel's patch."""
    return np.asarray(cv2.blur(image.astype(np.float32), (_PATCH, _PATCH)), np.float32)


def _warp(image: Bytes, homography: Array) -> Bytes:
    """Sample an image at the pixels that a homography maps to; 0 outside."""
    # Pixel centers are at + 0.5 in the package and at integers in OpenCV.
    shift = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    to_source = np.linalg.inv(shift) @ homography @ shift
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(image, to_source, image.shape[::-1], flags=flags), np.uint8)


def _radii(flow: Floats, homography: Array) -> list[Array]:
    """(h, w) distance from the center of each pixel, and of its target in the second image's own orientation."""
    height, width = flow.shape[:2]
    pixels = pixel_grid(height, width) + 0.5
    ends = cv2.perspectiveTransform((pixels + flow).astype(np.float64), homography)
    center = np.array([width / 2, height / 2])
    # A pixel that is measured is in view; elsewhere the homography may send it anywhere.
    return [
        np.linalg.norm(np.clip(places, -width, 2 * width) - center, axis=2) / (max(height, width) / 2)
        for places in (pixels, ends)
    ]


def detect_motion(match: Match, view: rigid.View, valid: Bools, *, search: bool = True) -> PairMotion:
    """Fit the error of the pose away, and find the regions of the first image that still move until the second.

    A pixel moves if its flow leaves the positions of static points by several standard deviations of the pair's own
    noise, and its patch matches the flow's target better than every static position, among the ``valid`` (h, w) pixels.
    Without ``search`` the pose alone is measured.
    """
    nothing = np.zeros(valid.shape, np.int32)
    voting = match.measured & (match.flow_error <= _MAX_EXPECTED_ERROR)
    count = int(voting.sum())
    if count < max(1.0, _MIN_PAIR_VOTING * valid.sum()):
        return PairMotion(nothing, count, math.nan, math.nan)
    pixels, flow = (pixel_grid(*valid.shape) + 0.5)[voting].astype(np.float64), match.flow[voting]
    correction = rigid.fit_correction(view, pixels, flow)
    growth = 1.0 + np.linalg.norm(rigid.corrected_flow(view, pixels, flow, correction), axis=1) / _DOUBLING
    before, after = (
        np.linalg.norm(rigid.static_residual(view, pixels, flow, pose_error), axis=1) / growth
        for pose_error in (np.zeros(6), correction)
    )
    noise_px, before_px = rigid.robust_scale(after), rigid.robust_scale(before)
    judged = noise_px <= _MAX_NOISE_PX
    if not (search and judged):
        return PairMotion(nothing, count, noise_px if judged else math.nan, before_px)
    moving = np.zeros(valid.shape, bool)
    moving[voting] = after > _DEVIATIONS * np.hypot(noise_px, match.flow_error[voting] / growth)
    # The patches reject wrong matches in repeating textures. Matching is slow, so it is skipped if no region remains.
    large = large_regions(moving) > 0
    if large.any():
        moving = _matched_better(match, view, correction, moving, large)
    return PairMotion(large_regions(moving), count, noise_px, before_px)


def _matched_better(match: Match, view: rigid.View, correction: Array, moving: Bools, large: Bools) -> Bools:
    """(h, w) bool: pixels of the ``large`` ones of moving regions that match the target of their flow better than any static position."""
    rows, columns = (
        slice(max(0, where.min() - _PATCH), where.max() + _PATCH + 1) for where in np.nonzero(large)
    )
    everywhere = pixel_grid(*moving.shape).astype(np.float64) + 0.5
    second = sample(match.second, rigid.turn(view.intrinsics, everywhere, -correction[:3]) - 0.5)
    pixels, first = everywhere[rows, columns], match.first[rows, columns]
    segment = rigid.static_segment(view, pixels, correction)
    length = np.linalg.norm(segment[large[rows, columns]], axis=-1).max()
    steps = min(_STEPS, 1 + math.ceil(length / _STEP))
    least = np.full(first.shape, np.inf, np.float32)
    for share in np.linspace(0.0, 1.0, steps + 1):
        np.minimum(least, _difference(first, second, pixels + share * segment), out=least)
    flow = rigid.corrected_flow(view, pixels, match.flow[rows, columns], correction)
    worse = least > _MIN_RATIO * _difference(first, second, pixels + flow) + _MIN_GAIN * match.noise
    found = np.zeros_like(moving)
    found[rows, columns] = moving[rows, columns] & worse
    return found


def _difference(first: Bytes, second: Bytes, targets: Array) -> Floats:
    """(h, w) float32 mean difference of each pixel's patch from the patch at its target [gray levels]."""
    return _mean_of_patch(cv2.absdiff(first, sample(second, targets - 0.5)))

"""Detect motion between two images: flow that neither the given pose nor a small error of it explains."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from egosplat.geometry import Array
from egosplat.moving_regions import Labels, large_regions
from egosplat.optical_flow import pixel_grid, sample
from egosplat.survey import rigid
from egosplat.survey.matching import PATCH, Bools, Floats, Gray, Match, mean_of_patch

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


@dataclass(frozen=True, eq=False)
class PairMotion:
    """What two images show.

    Attributes:
        regions: (h, w) int32, regions of the first image that move, numbered from 1; 0 elsewhere.
        voting: number of pixels that could show motion.
        noise_px: standard deviation of flow around static positions after the correction [px]; NaN if not judged.
        explained_px: mean flow that the correction explains [px]; NaN if not judged.
        before_px: standard deviation around static positions without the correction [px]; NaN if not judged.
    """

    regions: Labels
    voting: int
    noise_px: float
    explained_px: float
    before_px: float


def detect_motion(match: Match, view: rigid.View, valid: Bools, *, search: bool = True) -> PairMotion:
    """Fit the error of the pose away, and find the regions of the first image that still move until the second.

    A pixel moves if its flow leaves the positions of static points by several standard deviations of the pair's own
    noise, and its patch matches the flow's target better than every static position.

    Args:
        match: of the two images.
        view: their camera, position and depths.
        valid: (h, w) bool.
        search: False measures the pose alone.
    """
    nothing = np.zeros(valid.shape, np.int32)
    voting = match.measured & (match.flow_error <= _MAX_EXPECTED_ERROR)
    count = int(voting.sum())
    if count < max(1.0, _MIN_PAIR_VOTING * valid.sum()):
        return PairMotion(nothing, count, math.nan, math.nan, math.nan)
    pixels, flow = (pixel_grid(*valid.shape) + 0.5)[voting].astype(np.float64), match.flow[voting]
    correction = rigid.fit_correction(view, pixels, flow)
    before, after = (rigid.static_residual(view, pixels, flow, one) for one in (np.zeros(6), correction))
    explained_px = float(np.linalg.norm(before - after, axis=1).mean())
    growth = 1.0 + np.linalg.norm(rigid.corrected_flow(view, pixels, flow, correction), axis=1) / _DOUBLING
    distance = np.linalg.norm(after, axis=1) / growth
    noise_px = rigid.robust_scale(distance)
    before_px = rigid.robust_scale(np.linalg.norm(before, axis=1) / growth)
    judged = noise_px <= _MAX_NOISE_PX
    if not (search and judged):
        return PairMotion(nothing, count, noise_px if judged else math.nan, explained_px, before_px)
    moving = np.zeros(valid.shape, bool)
    moving[voting] = distance > _DEVIATIONS * np.hypot(noise_px, match.flow_error[voting] / growth)
    # The patches reject wrong matches in repeating textures. Matching is slow, so it is skipped if no region remains.
    large = large_regions(moving) > 0
    if large.any():
        moving = _matched_better(match, view, correction, moving, large)
    return PairMotion(large_regions(moving), count, noise_px, explained_px, before_px)


def _matched_better(match: Match, view: rigid.View, correction: Array, moving: Bools, large: Bools) -> Bools:
    """(h, w) bool: moving pixels whose patch matches the target of their flow better than any static position.

    Args:
        moving: (h, w) bool.
        large: (h, w) bool, the large regions of it; the other pixels are dropped.
    """
    rows, columns = (
        slice(max(0, where.min() - PATCH), where.max() + PATCH + 1) for where in np.nonzero(large)
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


def _difference(first: Gray, second: Gray, targets: Array) -> Floats:
    """(h, w) float32 mean difference of each pixel's patch from the patch at its target [gray levels]."""
    return mean_of_patch(cv2.absdiff(first, sample(second, targets - 0.5)))

"""Detect motion in a recording: optical flow that the known poses do not explain."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.geometry import Array, Camera
from egosplat.optical_flow import find_flow, is_consistent, padded, pixel_grid
from egosplat.progress import track
from egosplat.survey.brightness import gain_stops
from egosplat.survey.epipolar import epipolar_distance, find_epipole, max_static_flow, rotation_homography
from egosplat.survey.views import depth_quantile, visible_depths

Bools = NDArray[np.bool_]
Floats = NDArray[np.float32]
Grey = NDArray[np.uint8]

# Longest side of the images that flow is computed of [px].
SIDE = 256
# Motion is undecided if flow is reliable in less than this fraction of the valid pixels.
MIN_MEASURED = 0.2
MIN_PAIRS = 2
# Frames of a pair are this far apart, or as far as the next frame, up to a limit.
_PAIR_INTERVAL_S, _MAX_PAIR_INTERVAL_S = 0.2, 1.1
_MAX_PAIRS = 120
# Minimum depth of static points: half the depth of the nearest 2 % of the points.
_NEAR_QUANTILE, _NEAR_FACTOR = 0.02, 0.5
# Without points: an arm's length is 0.6 m.
_DEFAULT_MIN_DEPTH_M = 0.2

# Tolerated distance from the epipolar line [px], in addition to a tenth of the flow's length.
_TOLERANCE = 1.5
_RELATIVE = 0.1
# Tolerated forward-backward error [px].
_MAX_FLOW_ERROR = 1.0
# Flow is unreliable within this distance of the border of the common view [px].
_MARGIN = 8
# A moving pixel matches its flow better than any static position by this much [grey levels].
_MIN_GAIN = 6.0
# Spacing of the positions tried along the epipolar segment [px], and their maximum number.
_STEP, _STEPS = 1.5, 64
# Side of the patches that are compared [px].
_PATCH = 7
# Regions narrower than this [px], or smaller than this fraction of the image, are noise.
_MIN_WIDTH, _MIN_AREA = 7, 0.0015
_BLANK = 128


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion in P pairs of frames.

    Attributes:
        pairs: (P, 2) int64 frames.
        moving: (P,) float64 fraction of the measured pixels that moves; 0 if none is measured.
        measured: (P,) float64 fraction of the valid pixels with reliable flow.
        residual_px: (P,) float64 median distance of flow from where static points can appear [px]; NaN if unknown.
        stops: (P,) float64 exposure of the second frame relative to the first; NaN if unknown.
    """

    pairs: NDArray[np.int64]
    moving: Array
    measured: Array
    residual_px: Array
    stops: Array

    @property
    def share(self) -> float | None:
        """Mean of ``moving``; None if too little is measured."""
        enough = len(self.pairs) >= MIN_PAIRS and self.measured.mean() >= MIN_MEASURED
        return float(self.moving.mean()) if enough else None


@dataclass(frozen=True, eq=False)
class PairMotion:
    """Motion between two images.

    Attributes:
        measured, moving: (h, w) bool, pixels with reliable flow, and pixels that move.
        residual_px: median distance of flow from where static points can appear [px]; None if nothing is measured.
        stops: exposure of the second image relative to the first; None if unknown.
    """

    measured: Bools
    moving: Bools
    residual_px: float | None
    stops: float | None


def is_static(motion: Motion, threshold: float) -> bool:
    """Whether the moving share is measured and below a threshold."""
    return motion.share is not None and motion.share < threshold


def measure_motion(frames: Artifact, poses: Artifact) -> Motion:
    """Measure motion between pairs of frames throughout a recording."""
    pairs = choose_pairs(frames.read("timestamp_ns"), poses.read("registered"))
    camera_to_world, points = poses.read("camera_to_world"), poses.read("points/xyz")
    valid, camera = _working_view(frames, poses)
    size = valid.shape[::-1]
    moving, measured = np.zeros(len(pairs)), np.zeros(len(pairs))
    residual_px, stops = np.full(len(pairs), np.nan), np.full(len(pairs), np.nan)
    valid_count = max(1, int(valid.sum()))
    for row, (first, second) in enumerate(track(pairs, "measuring motion", unit="pair")):
        pair_poses = camera_to_world[first], camera_to_world[second]
        images = [_grey(frames.row("rgb", frame), size) for frame in (first, second)]
        min_depth = _min_depth(camera, pair_poses[0], points)
        motion = detect_motion(*images, valid, camera.matrix, pair_poses, min_depth)
        count = int(motion.measured.sum())
        moving[row], measured[row] = motion.moving.sum() / max(1, count), count / valid_count
        residual_px[row], stops[row] = motion.residual_px, motion.stops  # None becomes NaN
    return Motion(pairs, moving, measured, residual_px, stops)


def choose_pairs(times_ns: NDArray[np.int64], registered: Bools) -> NDArray[np.int64]:
    """Choose pairs of registered frames a short time apart, evenly over the recording.

    Args:
        times_ns: (F,) int64, increasing.
        registered: (F,) bool.

    Returns:
        (P, 2) int64.
    """
    known = np.flatnonzero(registered)
    # Half a millisecond of tolerance: a camera's clock is not exact.
    later = np.searchsorted(times_ns[known], times_ns[known] + round((_PAIR_INTERVAL_S - 5e-4) * 1e9))
    first = np.flatnonzero(later < len(known))
    pairs = np.stack([known[first], known[later[first]]], axis=1)
    pairs = pairs[np.diff(times_ns[pairs], axis=1)[:, 0] <= _MAX_PAIR_INTERVAL_S * 1e9]
    count = len(pairs)
    if count <= _MAX_PAIRS:
        return pairs
    # The middle pair of each of ``_MAX_PAIRS`` equal parts.
    return pairs[[count * (2 * part + 1) // (2 * _MAX_PAIRS) for part in range(_MAX_PAIRS)]]


def detect_motion(
    first: Grey, second: Grey, valid: Bools, intrinsics: Array, poses: tuple[Array, Array], min_depth: float
) -> PairMotion:
    """Find pixels of the first image that move until the second.

    A pixel moves if its flow leaves the epipolar segment of static points, and its patch matches the flow's target better
    than every position on the segment.

    Args:
        first, second: (h, w) uint8.
        valid: (h, w) bool, of both.
        intrinsics: (3, 3) matrix [px].
        poses: (4, 4) camera_to_world of each.
        min_depth: smallest depth of static points, positive [m].
    """
    homography = rotation_homography(intrinsics, *poses)
    rotated = _warp(second, homography)
    common = valid & (_warp(valid.astype(np.uint8), homography) > 0)
    # The border of the common view is blanked in both images, so that it is an edge without motion.
    first, rotated = (np.where(common, image, np.uint8(_BLANK)) for image in (first, rotated))
    forward, backward = _flow(first, rotated), _flow(rotated, first)
    measured = is_consistent(forward, backward, _MAX_FLOW_ERROR) & _without_margin(common)
    pixels, epipole = pixel_grid(*first.shape) + 0.5, find_epipole(intrinsics, *poses)
    # Errors of optical flow grow with its length.
    tolerance = _TOLERANCE + _RELATIVE * np.linalg.norm(forward, axis=2)
    distance = epipolar_distance(pixels, forward, epipole, min_depth)
    moving = measured & (distance > tolerance)
    # The patches reject wrong matches in repeating textures. Matching is slow, so it is skipped if no region remains.
    if large_regions(moving).any():
        segment = max_static_flow(pixels, epipole, min_depth)
        moving &= _patch_difference(first, rotated, forward) + _MIN_GAIN < _min_static_difference(
            first, rotated, segment
        )
    residual_px = float(np.median(distance[measured])) if measured.any() else None
    stops = gain_stops(first, _moved(rotated, forward), measured)
    return PairMotion(measured, large_regions(moving), residual_px, stops)


def large_regions(mask: Bools) -> Bools:
    """(h, w) bool: the parts of a mask that are wide and large enough to be an object."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_MIN_WIDTH, _MIN_WIDTH))
    wide = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(wide)
    large = statistics[:, cv2.CC_STAT_AREA] >= _MIN_AREA * mask.size
    large[0] = False  # the background
    return large[labels]


def _working_view(frames: Artifact, poses: Artifact) -> tuple[Bools, Camera]:
    """Valid pixels and camera at the size at which flow is computed."""
    _, height, width, _ = frames.shape("rgb")
    scale = min(1.0, SIDE / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    camera = Camera.from_matrix(poses.read("intrinsics"), width, height).scaled_to(*size)
    valid = cv2.resize(frames.read("valid").astype(np.float32), size, interpolation=cv2.INTER_AREA)
    # A small pixel is valid if all the pixels averaged into it are; the tolerance is for float32.
    return valid > 1 - 1e-6, camera


def _grey(rgb: NDArray[np.uint8], size: tuple[int, int]) -> Grey:
    return cv2.resize(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), size, interpolation=cv2.INTER_AREA)


def _min_depth(camera: Camera, camera_to_world: Array, points: Array) -> float:
    near = depth_quantile(visible_depths(camera, camera_to_world, points), _NEAR_QUANTILE)
    return _DEFAULT_MIN_DEPTH_M if near is None else _NEAR_FACTOR * near


def _flow(source: Grey, target: Grey) -> Floats:
    height, width = source.shape
    return find_flow(padded(source), padded(target))[:height, :width]


def _warp(image: Grey, homography: Array) -> Grey:
    """Sample an image at the pixels that a homography maps to; 0 outside."""
    height, width = image.shape
    # Pixel centres are at + 0.5 in the package and at integers in OpenCV.
    shift = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpPerspective(image, np.linalg.inv(shift) @ homography @ shift, (width, height), flags=flags)


def _without_margin(mask: Bools) -> Bools:
    """(h, w) bool: the mask without the pixels near its border."""
    # Padding makes the border of the image a border of the mask.
    framed = np.pad(mask, 1).astype(np.uint8)
    return cv2.distanceTransform(framed, cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1] > _MARGIN


def _min_static_difference(first: Grey, second: Grey, segment: Array) -> Floats:
    """(h, w) float32 smallest patch difference over all positions of a static point [grey levels]."""
    steps = min(_STEPS, 1 + math.ceil(np.linalg.norm(segment, axis=-1).max() / _STEP))
    least = np.full(first.shape, np.inf, np.float32)
    for share in np.linspace(0.0, 1.0, steps + 1):
        np.minimum(least, _patch_difference(first, second, share * segment), out=least)
    return least


def _patch_difference(first: Grey, second: Grey, flow: NDArray[np.floating]) -> Floats:
    """(h, w) float32 mean absolute difference between each pixel's patch and the patch at its target [grey levels]."""
    return cv2.blur(cv2.absdiff(first, _moved(second, flow)).astype(np.float32), (_PATCH, _PATCH))


def _moved(second: Grey, flow: NDArray[np.floating]) -> Grey:
    """The second image at the targets of flow from the first."""
    targets = (pixel_grid(*second.shape) + flow).astype(np.float32)
    return cv2.remap(second, targets, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

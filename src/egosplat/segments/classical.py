"""The classical segmenter: graph segmentation, region merging, and optical flow, without learned weights.

It is the baseline for SAM2, and an alternative for recordings unlike SAM2's training data.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.optical_flow import find_flow, is_consistent, pixel_grid, sample
from egosplat.progress import track as progress
from egosplat.segments.options import LEVELS
from egosplat.segments.partition import LIGHTNESS_WEIGHT, Bools, WorkingImage, partition, reduce_image
from egosplat.segments.video import LabelMaps, Labels, Segmented, Track, Video

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
# A region takes a label only if this share of its pixels has one, and if this share of those agrees; else its pixels
# keep their own labels.
LEAST_SUPPORT, PURITY = 0.15, 0.7
# An uncovered region becomes a new track if it has at least this share of the valid pixels.
_NEW_AREA = 1e-3


def segment_video(video: Video) -> Segmented:
    """Segment a video: the regions of each level, tracked by optical flow, as instances. Holds two frames in memory."""
    current = [np.full(video.shown(0).shape, -1, np.int32) for _ in LEVELS]
    labels, instances = LabelMaps((video.length, len(LEVELS), *current[0].shape)), []
    previous: WorkingImage | None = None
    for frame in progress(range(video.length), "tracking regions"):
        image = reduce_image(video.image(frame), video.shown(frame))
        fine, *levels = partition(image)
        origins = None
        if previous is not None and previous.shown.any() and image.shown.any():
            origins = find_origins(previous, image)
        # In the first frame every region becomes a track, however small.
        least = 1 if previous is None else _NEW_AREA * image.shown.sum()
        for level, regions in enumerate(levels):
            brought = np.full_like(fine, -1) if origins is None else propagate(current[level], *origins, fine)
            first = len(instances)
            current[level] = open_tracks(brought, regions, first, least)
            instances += [Track(level, frame, 1.0, 1.0)] * (int(current[level].max(initial=-1)) + 1 - first)
        labels[frame], previous = np.stack(current), image
    return Segmented(labels, instances, [], [])


def propagate(
    labels: Labels, rows: NDArray[np.int64], columns: NDArray[np.int64], known: Bools, regions: Labels
) -> Labels:
    """Propagate (H, W) int32 labels, -1 for none, to the next frame: a fine region takes the label of most of its pixels.

    A pixel that was hidden, out of view or without a label has no vote. ``rows``, ``columns``, ``known``: from ``find_origins``.
    """
    brought = np.where(known, labels[rows, columns], np.int32(-1))
    has_label = brought >= 0
    if not has_label.any():
        return np.full_like(brought, -1)
    count, kinds = int(regions.max()) + 1, np.int64(brought.max()) + 1
    cells, votes = np.unique(regions[has_label] * kinds + brought[has_label], return_counts=True)
    region, label = np.divmod(cells, kinds)
    # The last assignment wins: most votes, then the smallest label.
    order = np.lexsort((-label, votes))
    winner, most = np.full(count, -1, dtype=np.int32), np.zeros(count)
    winner[region[order]], most[region[order]] = label[order], votes[order]
    voters = np.bincount(region, votes, count)
    size = np.bincount(regions[regions >= 0], minlength=count)
    won = (voters >= LEAST_SUPPORT * size) & (most >= PURITY * voters) & (voters > 0)
    inside = np.maximum(regions, 0)
    return np.where(won[inside] & (regions >= 0), winner[inside], brought)


def open_tracks(labels: Labels, regions: Labels, first: int, least_pixels: float) -> Labels:
    """Start tracks, numbered from ``first``, for (H, W) regions of which no track covers ``least_pixels`` or more pixels."""
    uncovered = (labels < 0) & (regions >= 0)
    count = int(regions.max(initial=-1)) + 1
    large = np.flatnonzero(np.bincount(regions[uncovered], minlength=count) >= max(1, least_pixels))
    numbers = np.full(count + 1, -1, dtype=np.int32)
    numbers[large] = first + np.arange(len(large))
    return np.where(uncovered, numbers[regions], labels)


def find_origins(
    previous: WorkingImage, current: WorkingImage
) -> tuple[NDArray[np.int64], NDArray[np.int64], Bools]:
    """(H, W) int64 row and column of each pixel in the previous image, and (H, W) bool: whether that is known.

    By dense inverse search (Kroeger et al. 2016), with a forward-backward check, among pixels that show the scene.
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


def _flow(source: Gray, target: Gray, motion: NDArray[np.floating]) -> Floats:
    """(h, w, 2) float32 displacement (x, y) of each pixel of ``source`` in ``target`` [px]."""
    # Remove the camera's motion, a homography, first: a turning head moves pixels further than the search
    # finds among repeating textures.
    start = pixel_grid(*source.shape)
    target = sample(target, np.asarray(cv2.perspectiveTransform(start, motion), np.float32))
    ends = cv2.perspectiveTransform(start + find_flow(source, target), motion)
    return np.asarray(ends, np.float32) - start


def _camera_motion(source: Gray, target: Gray) -> NDArray[np.float64]:
    """(3, 3) homography from pixels (x, y) of one (h, w) image to another; the identity if none is found."""
    if min(source.shape) < _LEAST_SIDE:
        return np.eye(3)
    finder = cv2.ORB.create(_FEATURES, fastThreshold=_FAST_THRESHOLD)
    here, here_codes = finder.detectAndCompute(source, None)
    there, there_codes = finder.detectAndCompute(target, None)
    if min(len(here), len(there)) < _LEAST_MATCHES:
        return np.eye(3)
    matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(here_codes, there_codes)
    if len(matches) < _LEAST_MATCHES:
        return np.eye(3)
    begin = np.array([here[match.queryIdx].pt for match in matches], dtype=np.float32)
    end = np.array([there[match.trainIdx].pt for match in matches], dtype=np.float32)
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
    return np.asarray(found, np.float64) if ahead and near and in_order else np.eye(3)

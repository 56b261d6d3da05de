"""The classical segmenter: superpixels, merged in the order of their similarity, and optical flow, without
learned weights. It is the baseline for SAM2, and an alternative for recordings unlike SAM2's training data. A
difference is a distance in CIELAB: about 2 is just noticeable. Numbers are tuned on synthetic apartments."""

import heapq

import cv2
import numpy as np

from egosplat.arrays import Array, Bools, Bytes, Floats, Ints, Ints32, Reals
from egosplat.images import resize_labels, shrunk_size
from egosplat.optical_flow import find_flow, is_consistent, pixel_grid, sample
from egosplat.progress import track as progress
from egosplat.segments.options import LEVELS
from egosplat.segments.video import LabelMaps, Segmented, Track, Video

# Longest side at which images are segmented [px]; larger ones are reduced. Lengths below are at this side.
_SIDE = 384
# Superpixels: sigma of the blur [px], Felzenszwalb and Huttenlocher's k [difference x share of the valid pixels].
_SMOOTHING, _GRANULARITY = 0.7, 2e-5
# Smaller [share of the valid pixels] and thinner [px] regions are merged into their most similar neighbor.
_LEAST_AREA, _LEAST_WIDTH = 3e-4, 1.5
# Weights of differences in lightness and in strength of texture; that of the color axes is 1.
_LIGHTNESS_WEIGHT, _TEXTURE_WEIGHT = 0.4, 2.0
# Weight of the gradient across the common boundary [difference per difference/px], and sigma of its blur [px].
_EDGE_WEIGHT, _EDGE_SCALE = 0.5, 4.0
# A difference between areas a and b counts times ``(100 * a * b / (a + b)) ** _SIZE_POWER``, and less by the second if the
# common boundary is the whole outline of one of them.
_SIZE_POWER, _CONTACT_WEIGHT = 0.5, 0.5
# Least difference between regions of a level (subpart, part, whole), for areas of one percent.
_LEVELS = (3.5, 12.0, 29.0)
# Histograms: number of bins, and the ranges of lightness, color, and strength of texture.
_BINS, _LIGHTNESS, _COLOR, _TEXTURE = 20, (0.0, 100.0), (-60.0, 60.0), (0.0, 40.0)
# Texture is the difference to a blur of the first sigma; its power is averaged by the second [px].
_DETAIL, _NEIGHBORHOOD = 2.0, 3.0
# Largest gap between forward and backward flow at the nominal side [px], besides a tenth of their length.
_FLOW_ERROR = 8.0
# Largest color change of a pixel between frames [CIELAB], after smoothing with a Gaussian of this sigma [px].
_COLOR_ERROR, _SURROUNDINGS = 15.0, 2.0
# ORB: smallest side of images [px], as its pyramid fails in tiny ones; numbers of features and of matches.
_LEAST_SIDE, _FEATURES, _FAST_THRESHOLD, _LEAST_MATCHES = 64, 1500, 7, 12
# Homography: RANSAC's tolerance as a share of the longer side, and of the matches that must agree: near objects move more.
_TOLERANCE, _LEAST_INLIERS, _SEED = 0.015, 0.2, 1
# A region takes a label only if this share of its pixels has one, and this share of those agrees; else its pixels keep theirs.
LEAST_SUPPORT, PURITY = 0.15, 0.7
# An uncovered region becomes a new track if it has at least this share of the valid pixels.
_NEW_AREA = 1e-3


class WorkingImage:
    """An image at the working size, (h, w, 3) CIELAB; invalid pixels have the color of the nearest valid one.
    Pixels are ``valid`` (h, w) at least in part, and ``shown`` (H, W) in the original image; ``unit`` is the
    number of working pixels per pixel at the nominal side, at most 1."""

    def __init__(self, image: Bytes, shown: Bools) -> None:
        """Reduce an (H, W, 3) uint8 RGB image to the working size; pixels outside of (H, W) ``shown`` have no influence."""
        height, width = shown.shape
        size = shrunk_size(width, height, _SIDE)
        weight = cv2.resize(shown.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        kept = np.where(shown[..., None], image, 0).astype(np.float32) / 255
        valid = weight > 1e-6
        # The mean over valid pixels only.
        rgb = cv2.resize(kept, size, interpolation=cv2.INTER_AREA) / np.where(valid, weight, 1)[..., None]
        if valid.any() and not valid.all():
            _, nearest = cv2.distanceTransformWithLabels(
                (~valid).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
            )
            nearest = np.asarray(nearest, np.int32)
            color_of = np.zeros((nearest.max() + 1, 3), np.float32)
            color_of[nearest[valid]] = rgb[valid]
            rgb = color_of[nearest]
        lab = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB), np.float32)
        self.lab, self.valid, self.shown, self.unit = lab, valid, shown, max(size) / _SIDE


def segment_video(video: Video) -> Segmented:
    """Segment a video: the regions of each level, tracked by optical flow, as instances. Holds two frames in memory."""
    current = [np.full(video.shown(0).shape, -1, np.int32) for _ in LEVELS]
    labels, instances = LabelMaps((video.length, len(LEVELS), *current[0].shape)), []
    previous: WorkingImage | None = None
    for frame in progress(range(video.length), "tracking regions"):
        image = WorkingImage(video.image(frame), video.shown(frame))
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


def propagate(labels: Ints32, rows: Ints, columns: Ints, known: Bools, regions: Ints32) -> Ints32:
    """Propagate (H, W) int32 labels, -1 for none, to the next frame: a fine region takes the label of most of
    its pixels. A pixel that was hidden, out of view or without a label has no vote. ``rows``, ``columns``,
    ``known``: from ``find_origins``."""
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


def open_tracks(labels: Ints32, regions: Ints32, first: int, least_pixels: float) -> Ints32:
    """Start tracks, numbered from ``first``, for (H, W) regions of which no track covers ``least_pixels`` or more pixels."""
    uncovered = (labels < 0) & (regions >= 0)
    count = int(regions.max(initial=-1)) + 1
    large = np.flatnonzero(np.bincount(regions[uncovered], minlength=count) >= max(1, least_pixels))
    numbers = np.full(count + 1, -1, dtype=np.int32)
    numbers[large] = first + np.arange(len(large))
    return np.where(uncovered, numbers[regions], labels)


def find_origins(previous: WorkingImage, current: WorkingImage) -> tuple[Ints, Ints, Bools]:
    """(H, W) int64 row and column of each pixel in the previous image, and (H, W) bool: whether that is
    known. By dense inverse search (Kroeger et al. 2016), with a forward-backward check, among pixels that
    show the scene."""
    height, width = current.shown.shape
    # CIELAB lightness, 0 to 100, as uint8: optical flow needs one 8-bit channel.
    earlier, now = (np.rint(one.lab[..., 0] * 2.55).astype(np.uint8) for one in (previous, current))
    motion = _camera_motion(now, earlier)
    backward, forward = _flow(now, earlier, motion), _flow(earlier, now, np.linalg.inv(motion))
    shape = previous.valid.shape
    agrees = is_consistent(backward, forward, _FLOW_ERROR * previous.unit)
    # A pixel's neighborhood has the color of the neighborhood at its origin.
    warped = sample(previous.lab, pixel_grid(*current.valid.shape) + backward)
    apart = cv2.GaussianBlur(current.lab - warped, (0, 0), _SURROUNDINGS * current.unit)
    apart[..., 0] *= _LIGHTNESS_WEIGHT
    agrees &= np.linalg.norm(apart, axis=2) <= _COLOR_ERROR
    scale = np.array([width / shape[1], height / shape[0]], dtype=np.float32)
    backward = cv2.resize(backward, (width, height), interpolation=cv2.INTER_LINEAR)
    agrees = cv2.resize(agrees.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0
    rows, columns = np.indices((height, width))
    rows = np.rint(rows + backward[..., 1] * scale[1]).astype(np.int64)
    columns = np.rint(columns + backward[..., 0] * scale[0]).astype(np.int64)
    within = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    rows, columns = rows.clip(0, height - 1), columns.clip(0, width - 1)
    return rows, columns, agrees & within & current.shown & previous.shown[rows, columns]


def _flow(source: Bytes, target: Bytes, motion: Reals) -> Floats:
    """(h, w, 2) float32 displacement (x, y) of each pixel of ``source`` in ``target`` [px]."""
    # Remove the camera's motion, a homography, first: a turning head moves pixels further than the search
    # finds among repeating textures.
    start = pixel_grid(*source.shape)
    target = sample(target, np.asarray(cv2.perspectiveTransform(start, motion), np.float32))
    ends = cv2.perspectiveTransform(start + find_flow(source, target), motion)
    return np.asarray(ends, np.float32) - start


def _camera_motion(source: Bytes, target: Bytes) -> Array:
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


def partition(image: WorkingImage) -> Ints32:
    """Divide an image into nested regions; those of a level are unions of regions of the next finer one. The
    two most similar neighbors are merged repeatedly (binary partition tree, Salembier and Garrido 2000). The
    difference of two regions is the earth mover's distance of their colors and textures plus the gradient
    across their boundary; it is reduced for small and for enclosed regions. Returns (4, H, W) int32 fine
    regions, subparts, parts and wholes, numbered from 0 at each level, -1 outside of ``shown``."""
    height, width = image.shown.shape
    if not image.shown.any():
        return np.full((4, height, width), -1, np.int32)
    superpixels = _superpixels(image)
    merging = _Merging(image, superpixels)
    levels = [merging.region.copy()]
    for threshold in _LEVELS:
        merging.merge_below(threshold)
        levels.append(merging.region.copy())
    numbered = np.stack([np.unique(level, return_inverse=True)[1] for level in levels]).astype(np.int32)
    return np.where(image.shown, resize_labels(numbered[:, superpixels], width, height), np.int32(-1))


def _superpixels(image: WorkingImage) -> Ints32:
    """(h, w) int32 superpixel of each valid pixel (Felzenszwalb and Huttenlocher 2004), -1 elsewhere."""
    # Sizes are shares of the valid area, so that results do not depend on the image's size.
    pixels = image.valid.sum()
    cutter = cv2.ximgproc.segmentation.createGraphSegmentation(
        sigma=_SMOOTHING * image.unit,
        k=float(_GRANULARITY * pixels),
        min_size=max(1, int(_LEAST_AREA * pixels / 2)),
    )
    labels = np.full(image.valid.shape, -1, dtype=np.int32)
    labels[image.valid] = np.unique(cutter.processImage(image.lab)[image.valid], return_inverse=True)[1]
    return labels


def _profiles(image: WorkingImage, labels: Ints32, count: int) -> Array:
    """(count, 4, B) cumulative histograms of lightness, a, b and texture, summed over the pixels of each label."""
    # Scaled, so that the absolute differences of two, each divided by its area, sum to the weighted earth mover's distance.
    lab, unit = image.lab, image.unit
    power = np.square(lab - cv2.GaussianBlur(lab, (0, 0), _DETAIL * unit)).sum(axis=2)
    texture = np.sqrt(cv2.GaussianBlur(power, (0, 0), _NEIGHBORHOOD * unit))
    channels = (
        (lab[..., 0], _LIGHTNESS, _LIGHTNESS_WEIGHT),
        (lab[..., 1], _COLOR, 1.0),
        (lab[..., 2], _COLOR, 1.0),
        (texture, _TEXTURE, _TEXTURE_WEIGHT),
    )
    first, profiles = labels[image.valid] * np.int64(_BINS), []
    for values, (low, high), weight in channels:
        bins = np.clip((values[image.valid] - low) / (high - low), 0, 1) * (_BINS - 1)
        lower = np.minimum(bins.astype(np.int64), _BINS - 2)
        # A value between the centers of two bins counts for both: else slow changes of light would appear as jumps.
        upper_share, cells = bins - lower, first + lower
        counts = np.bincount(cells, 1 - upper_share, count * _BINS)
        counts += np.bincount(cells + 1, upper_share, count * _BINS)
        profiles.append(counts.reshape(count, _BINS).cumsum(axis=1) * (weight * (high - low) / (_BINS - 1)))
    return np.stack(profiles, axis=1)


Neighbors = list[dict[int, tuple[float, float]]]
"""By region, its neighbors: length of the common boundary [px], and the gradient summed along it [CIELAB/px x px]."""


def _neighbors(image: WorkingImage, labels: Ints32, count: int) -> Neighbors:
    smooth = cv2.GaussianBlur(image.lab, (0, 0), _EDGE_SCALE * image.unit)
    along = [cv2.Sobel(smooth, cv2.CV_32F, *axis, scale=1 / 8) for axis in ((1, 0), (0, 1))]
    gradient = np.sqrt(np.square(along[0]).sum(axis=2) + np.square(along[1]).sum(axis=2))
    keys, edges = [], []
    for before, after in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        here, there = labels[before], labels[after]
        touch = (here != there) & (here >= 0) & (there >= 0)
        low, high = np.minimum(here, there)[touch], np.maximum(here, there)[touch]
        keys.append(low * np.int64(count) + high)
        edges.append(np.maximum(gradient[before], gradient[after])[touch])
    pairs, number, length = np.unique(np.concatenate(keys), return_inverse=True, return_counts=True)
    edge = np.bincount(number, np.concatenate(edges), len(pairs))
    found: Neighbors = [{} for _ in range(count)]
    for pair, *boundary in zip(pairs.tolist(), length.tolist(), edge.tolist(), strict=True):
        a, b = divmod(pair, count)
        found[a][b] = found[b][a] = tuple(boundary)
    return found


class _Merging:
    """A partition that becomes coarser; a region has the number of one of its superpixels."""

    def __init__(self, image: WorkingImage, labels: Ints32) -> None:
        """Start from superpixels, without those that are too small or too thin."""
        count = int(labels.max()) + 1
        self.region = np.arange(count)
        self._members = [[number] for number in range(count)]
        self._area = np.bincount(labels[image.valid], minlength=count).astype(np.float64)
        self._hundredth = self._area.sum() / 100
        self._sum = _profiles(image, labels, count)
        self._mean = self._sum / self._area[:, None, None]
        self._neighbors = _neighbors(image, labels, count)
        self._outline = np.array([self._length(number) for number in range(count)])
        # Merging a region raises its version: queue entries of an older version are ignored.
        self._version = [0] * count
        self._queue: list[tuple[float, int, int, int, int]] = []
        self._clean(_LEAST_AREA * image.valid.sum(), _LEAST_WIDTH * image.unit)
        for number, neighbors in enumerate(self._neighbors):
            self._push(number, [other for other in neighbors if other > number])

    def merge_below(self, threshold: float) -> None:
        """Merge until all neighboring regions differ by at least ``threshold``."""
        while self._queue and self._queue[0][0] < threshold:
            _, a, b, version_a, version_b = heapq.heappop(self._queue)
            if (self._version[a], self._version[b]) == (version_a, version_b):
                kept = self._merge(a, b)
                self._push(kept, list(self._neighbors[kept]))

    def _clean(self, least_area: float, least_width: float) -> None:
        """Merge regions that are too small or too thin, the smallest first, into their most similar neighbor."""
        queue = [(area, number) for number, area in enumerate(self._area)]
        heapq.heapify(queue)
        while queue:
            area, number = heapq.heappop(queue)
            large = area >= least_area and 2 * area >= least_width * self._outline[number]
            # An outdated entry is one of a region that was merged meanwhile.
            if large or area != self._area[number] or not self._neighbors[number]:
                continue
            others = list(self._neighbors[number])
            kept = self._merge(number, others[int(np.argmin(self._differences(number, others)))])
            heapq.heappush(queue, (self._area[kept], kept))

    def _push(self, number: int, others: list[int]) -> None:
        """Queue pairs of a region and K neighbors by their differences, weighed by their sizes and common boundaries."""
        if not others:
            return
        length = np.array([self._neighbors[number][other][0] for other in others])
        # As in Ward's criterion: about the smaller area if the areas differ much, half of it if they are equal.
        size = self._area[others] * self._area[number] / (self._area[others] + self._area[number])
        contact = length / np.minimum(self._outline[others], self._outline[number])
        weight = (size / self._hundredth) ** _SIZE_POWER * (1 - _CONTACT_WEIGHT * contact)
        weighed = self._differences(number, others) * weight
        for difference, other in zip(weighed.tolist(), others, strict=True):
            versions = self._version[number], self._version[other]
            heapq.heappush(self._queue, (difference, number, other, *versions))

    def _differences(self, number: int, others: list[int]) -> Array:
        """(K,) difference of a region to each of K neighbors [CIELAB]."""
        apart = np.abs(self._mean[others] - self._mean[number]).sum(axis=2)
        boundary = np.array([self._neighbors[number][other] for other in others])
        return np.sqrt(np.square(apart).sum(axis=1)) + _EDGE_WEIGHT * (boundary[:, 1] / boundary[:, 0])

    def _merge(self, a: int, b: int) -> int:
        """Merge two neighbors; returns the number of the larger, which the region keeps."""
        kept, gone = (a, b) if (self._area[a], -a) >= (self._area[b], -b) else (b, a)
        self._sum[kept] += self._sum[gone]
        self._area[kept] += self._area[gone]
        self._area[gone] = 0
        self._mean[kept] = self._sum[kept] / self._area[kept]
        self._version[kept] += 1
        self._version[gone] = -1
        self.region[self._members[gone]] = kept
        self._members[kept] += self._members[gone]
        mine, its = self._neighbors[kept], self._neighbors[gone]
        del its[kept], mine[gone]
        for other, (length, edge) in its.items():
            del self._neighbors[other][gone]
            known_length, known_edge = mine.get(other, (0.0, 0.0))
            mine[other] = self._neighbors[other][kept] = (known_length + length, known_edge + edge)
        its.clear()
        self._outline[kept] = self._length(kept)
        return kept

    def _length(self, number: int) -> float:
        return sum(length for length, _ in self._neighbors[number].values())

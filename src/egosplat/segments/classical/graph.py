"""Superpixels of an image as a graph: color and texture of each region, boundaries between neighbors."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat.segments.classical.options import ClassicalOptions
from egosplat.segments.classical.working_image import WorkingImage

Floats = NDArray[np.float64]

_BINS = 20
# Ranges of the histograms: CIELAB, and the standard deviation of CIELAB in a neighborhood.
_LIGHTNESS, _COLOR, _TEXTURE = (0.0, 100.0), (-60.0, 60.0), (0.0, 40.0)
# Texture is the difference to a Gaussian blur of the first sigma; its power is averaged by the second [px at
# side].
_DETAIL, _NEIGHBORHOOD = 2.0, 3.0


@dataclass(frozen=True, eq=False)
class RegionGraph:
    """Regions and their boundaries.

    Attributes:
        labels: (h, w) int32 region of each pixel, -1 for none.
        area: (N,) [px].
        profile: (N, 4, B) cumulative histograms of lightness, a, b and texture, summed over the pixels. They are
            scaled: the absolute differences of two profiles, each divided by its area, sum to the weighted earth
            mover's distance.
        pairs: (E, 2) neighboring regions, smaller number first.
        length: (E,) length of their common boundary [px].
        edge: (E,) gradient summed along that boundary [CIELAB/px x px].
    """

    labels: NDArray[np.int32]
    area: Floats
    profile: Floats
    pairs: NDArray[np.int64]
    length: Floats
    edge: Floats


def make_graph(working: WorkingImage, options: ClassicalOptions) -> RegionGraph:
    """Divide an image into superpixels (Felzenszwalb and Huttenlocher 2004) and connect neighbors."""
    lab = cv2.cvtColor(working.rgb, cv2.COLOR_RGB2LAB)
    labels = _superpixels(lab, working, options)
    count = int(labels.max()) + 1
    inside = labels >= 0
    area = np.bincount(labels[inside], minlength=count).astype(np.float64)
    channels = (
        (lab[..., 0], _LIGHTNESS, options.lightness_weight),
        (lab[..., 1], _COLOR, 1.0),
        (lab[..., 2], _COLOR, 1.0),
        (_texture(lab, working.unit), _TEXTURE, options.texture_weight),
    )
    profile = [_profile(channel[inside], labels[inside], count, *rest) for channel, *rest in channels]
    gradient = _gradient(lab, options.edge_scale * working.unit)
    return RegionGraph(labels, area, np.stack(profile, axis=1), *_boundaries(labels, gradient, count))


def _superpixels(
    lab: NDArray[np.float32], working: WorkingImage, options: ClassicalOptions
) -> NDArray[np.int32]:
    # Sizes are shares of the valid area, so that results do not depend on the image's size.
    pixels = working.valid.sum()
    cutter = cv2.ximgproc.segmentation.createGraphSegmentation(
        sigma=options.smoothing * working.unit,
        k=float(options.granularity * pixels),
        min_size=max(1, int(options.least_area * pixels / 2)),
    )
    found = cutter.processImage(lab)
    labels = np.full(found.shape, -1, dtype=np.int32)
    labels[working.valid] = np.unique(found[working.valid], return_inverse=True)[1]
    return labels


def _texture(lab: NDArray[np.float32], unit: float) -> NDArray[np.float32]:
    """(h, w) strength of the texture around each pixel [CIELAB]."""
    detail = lab - cv2.GaussianBlur(lab, (0, 0), _DETAIL * unit)
    power = np.square(detail).sum(axis=2)
    return np.sqrt(cv2.GaussianBlur(power, (0, 0), _NEIGHBORHOOD * unit))


def _gradient(lab: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    """(h, w) length of the gradient over the three channels [CIELAB/px]."""
    smooth = cv2.GaussianBlur(lab, (0, 0), sigma)
    along = [cv2.Sobel(smooth, cv2.CV_32F, *axis, scale=1 / 8) for axis in ((1, 0), (0, 1))]
    return np.sqrt(sum(np.square(one).sum(axis=2) for one in along))


def _profile(
    values: NDArray[np.float32],
    labels: NDArray[np.int32],
    count: int,
    bounds: tuple[float, float],
    weight: float,
) -> Floats:
    """(count, B) cumulative histograms of the values under each label, times the width of a bin."""
    low, high = bounds
    place = np.clip((values - low) / (high - low), 0, 1) * (_BINS - 1)
    lower = np.minimum(place.astype(np.int64), _BINS - 2)
    # A value between the centers of two bins counts for both: else slow changes of light would appear as jumps.
    upper_share = place - lower
    cells = labels * np.int64(_BINS) + lower
    counts = np.bincount(cells, 1 - upper_share, count * _BINS)
    counts += np.bincount(cells + 1, upper_share, count * _BINS)
    return counts.reshape(count, _BINS).cumsum(axis=1) * (weight * (high - low) / (_BINS - 1))


def _boundaries(
    labels: NDArray[np.int32], gradient: NDArray[np.float32], count: int
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Pairs of neighboring regions, the length of each boundary, and the gradient summed along it."""
    keys, edges = [], []
    for before, after in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        here, there = labels[before], labels[after]
        touch = (here != there) & (here >= 0) & (there >= 0)
        low, high = np.minimum(here, there)[touch], np.maximum(here, there)[touch]
        keys.append(low * np.int64(count) + high)
        edges.append(np.maximum(gradient[before], gradient[after])[touch])
    pairs, number = np.unique(np.concatenate(keys), return_inverse=True)
    length = np.bincount(number, minlength=len(pairs)).astype(np.float64)
    edge = np.bincount(number, np.concatenate(edges), len(pairs))
    return np.column_stack(np.divmod(pairs, max(count, 1))), length, edge

"""Regions of moving pixels that are large enough to be an object and go on in the next frames, and instances' mean probability."""

import cv2
import numpy as np

from egosplat.arrays import Array, Bools, Bytes, Ints32, Reals

# A row, of a frame or of a pair of frames, and a region of its first image.
Region = tuple[int, int]

# Regions narrower than this [px], or smaller than this fraction of the image, are noise.
_MIN_WIDTH, _MIN_AREA = 5, 0.0008
# A thing moves in at least so many consecutive pairs of frames.
_MIN_TRACK = 3
# A region goes on if this fraction of it, or of the region that it meets, lies within this part of the image's side.
_MIN_OVERLAP, _REACH = 0.3, 0.04


def large_regions(mask: Bools) -> Ints32:
    """(h, w) int32: the parts of a mask that are wide and large enough to be an object, numbered from 1; 0 elsewhere."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_MIN_WIDTH, _MIN_WIDTH))
    # Pixels without a vote leave holes in a region.
    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    wide = cv2.morphologyEx(closed, cv2.MORPH_OPEN, kernel)
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(wide)
    large = statistics[:, cv2.CC_STAT_AREA] >= _MIN_AREA * mask.size
    large[0] = False  # the background
    return np.where(large[np.asarray(labels, np.int32)], labels, 0)


def landing(labels: Ints32, flow: Reals, homography: Array) -> Ints32:
    """(h, w) int32: the regions of the first image at their places in the second image.

    Args:
        labels: (h, w) int32 regions of the first image.
        flow: (h, w, 2) to the second image in the orientation of the first [px].
        homography: (3, 3) from there to the second image's own orientation.
    """
    rows, columns = np.nonzero(labels)
    ends = np.stack([columns + 0.5, rows + 0.5], axis=1) + flow[rows, columns]
    x, y, scale = (homography[:, :2] * ends[:, None]).sum(axis=-1).T + homography[:, 2:]
    seen = scale > 1e-6
    with np.errstate(over="ignore"):
        places = np.floor(np.stack([y[seen], x[seen]], axis=1) / scale[seen, None])
    inside = ((places >= 0) & (places < labels.shape)).all(axis=1)
    found = np.zeros_like(labels)
    found[tuple(places[inside].astype(np.int64).T)] = labels[rows, columns][seen][inside]
    return found


def meetings(arrived: Ints32, following: Ints32) -> list[tuple[int, int]]:
    """Pairs (region, region of the next pair of frames) that are one moving thing.

    Args:
        arrived: (h, w) int32 regions at their places in the image that both pairs share.
        following: (h, w) int32 regions of that image in the next pair.
    """
    size = 2 * round(_REACH * max(arrived.shape)) + 1
    reach = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    there = [(int(one), following == one) for one in np.unique(following[following > 0])]
    found = []
    for here in np.unique(arrived[arrived > 0]):
        mask = arrived == here
        found += [(int(here), other) for other, goal in there if _overlap(mask, goal, reach) > _MIN_OVERLAP]
    return found


def lasting_regions(links: list[tuple[Region, Region]]) -> set[Region]:
    """Regions of tracks that last for at least three pairs of frames, from the links of regions in consecutive pairs."""
    before: dict[Region, int] = {}
    after: dict[Region, int] = {}
    for first, second in sorted(links):
        before[second] = max(before.get(second, 1), before.get(first, 1) + 1)
    for first, second in sorted(links, reverse=True):
        after[first] = max(after.get(first, 1), after.get(second, 1) + 1)
    regions = before.keys() | after.keys()
    return {one for one in regions if before.get(one, 1) + after.get(one, 1) - 1 >= _MIN_TRACK}


def _overlap(first: Bools, second: Bools, reach: Bytes) -> float:
    """Fraction of either mask, whichever is larger, that lies near the other."""
    near = cv2.dilate(first.astype(np.uint8), reach) > 0, cv2.dilate(second.astype(np.uint8), reach) > 0
    return max((second & near[0]).sum() / second.sum(), (first & near[1]).sum() / first.sum())


class InstanceScores:
    """Mean probability of each of N instances over its ``pixels`` in all added frames, (N,) int64, as in the paper's set D."""

    def __init__(self, count: int) -> None:
        """Start without frames; ``count`` is the number of instances N."""
        self._sums = np.zeros(count)
        self.pixels = np.zeros(count, np.int64)

    def add(self, labels: Ints32, probability: Reals) -> None:
        """Add a frame: (L, H, W) instance at each level, -1 for none, and (H, W) probability in [0, 1]."""
        # float64: sums over all frames of a video exceed the digits of float16 and float32.
        weight = probability.astype(np.float64)
        for level in labels:
            seen = level >= 0
            found = level[seen]
            self.pixels += np.bincount(found, minlength=len(self.pixels))
            self._sums += np.bincount(found, weights=weight[seen], minlength=len(self._sums))

    @property
    def scores(self) -> Array:
        """(N,) mean probability of each instance; 0 if it has no pixel."""
        # Pooled over pixels, so a large view of an instance has more weight than a small one.
        return np.divide(self._sums, self.pixels, out=np.zeros_like(self._sums), where=self.pixels > 0)

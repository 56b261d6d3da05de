"""Divide an image into nested regions: superpixels, merged in the order of their similarity."""

import heapq

import numpy as np
from numpy.typing import NDArray

from egosplat.images import resize_labels
from egosplat.segments.classical.graph import Floats, RegionGraph, make_graph
from egosplat.segments.classical.options import ClassicalOptions
from egosplat.segments.classical.working_image import resize_to_side


def partition(
    image: NDArray[np.uint8], valid: NDArray[np.bool_], options: ClassicalOptions
) -> NDArray[np.int32]:
    """Divide an image into nested regions; those of a level are unions of regions of the next finer one.

    Args:
        image: (H, W, 3) uint8 RGB.
        valid: (H, W) bool; pixels outside have no influence.

    Returns:
        (4, H, W) int32 fine regions, subparts, parts and wholes, numbered from 0 at each level, -1 outside of ``valid``.
    """
    if not valid.any():
        return np.full((4, *valid.shape), -1, dtype=np.int32)
    working = resize_to_side(image, valid, options.side)
    graph = make_graph(working, options)
    levels = merge_levels(graph, working.unit, options)
    return np.where(valid, resize_labels(levels[:, graph.labels], *working.shape[::-1]), np.int32(-1))


def merge_levels(graph: RegionGraph, unit: float, options: ClassicalOptions) -> NDArray[np.int32]:
    """Merge superpixels into the regions of each level.

    The two most similar neighbors are merged repeatedly (binary partition tree, Salembier and Garrido 2000). The
    difference of two regions is the earth mover's distance of their colors and textures plus the gradient across
    their boundary; it is reduced for small and for enclosed regions, see ``ClassicalOptions``.

    Args:
        graph: of N superpixels.
        unit: see ``WorkingImage``.
        options: thresholds of the levels and weights of the difference.

    Returns:
        (4, N) int32 region of each superpixel: fine regions, subparts, parts, wholes; each numbered from 0 without gaps.
    """
    merging = _Merging(graph, options)
    merging.clean(options.least_area * graph.area.sum(), options.least_width * unit)
    levels = [merging.region.copy()]
    merging.start()
    for threshold in (options.subpart, options.part, options.whole):
        merging.merge_below(threshold)
        levels.append(merging.region.copy())
    return np.stack([np.unique(level, return_inverse=True)[1] for level in levels]).astype(np.int32)


class _Merging:
    """A partition that becomes coarser; a region has the number of one of its superpixels."""

    def __init__(self, graph: RegionGraph, options: ClassicalOptions) -> None:
        count = len(graph.area)
        self.region = np.arange(count)
        self._options = options
        self._hundredth = graph.area.sum() / 100
        self._members = [[number] for number in range(count)]
        self._area = graph.area.copy()
        self._sum = graph.profile.copy()
        self._mean = graph.profile / graph.area[:, None, None]
        self._neighbors: list[dict[int, tuple[float, float]]] = [{} for _ in range(count)]
        for (a, b), *boundary in zip(
            graph.pairs.tolist(), graph.length.tolist(), graph.edge.tolist(), strict=True
        ):
            self._neighbors[a][b] = self._neighbors[b][a] = tuple(boundary)
        self._outline = np.array([_length(one) for one in self._neighbors])
        # Merging a region raises its version: queue entries of an older version are ignored.
        self._version = [0] * count
        self._queue: list[tuple[float, int, int, int, int]] = []

    def clean(self, least_area: float, least_width: float) -> None:
        """Merge regions that are too small or too thin, the smallest first, into their most similar neighbor."""

        def is_poor(number: int) -> bool:
            area = self._area[number]
            return area < least_area or 2 * area < least_width * self._outline[number]

        queue = [(self._area[one], one) for one in self.region.tolist() if is_poor(one)]
        heapq.heapify(queue)
        while queue:
            area, number = heapq.heappop(queue)
            if area != self._area[number] or not self._neighbors[number]:
                continue  # an outdated entry: the region was merged meanwhile
            others = list(self._neighbors[number])
            kept = self._merge(number, others[int(np.argmin(self._differences(number, others)))])
            if is_poor(kept):
                heapq.heappush(queue, (self._area[kept], kept))

    def start(self) -> None:
        """Queue all pairs of neighbors."""
        for number, neighbors in enumerate(self._neighbors):
            self._push(number, [other for other in neighbors if other > number])

    def merge_below(self, threshold: float) -> None:
        """Merge until all neighboring regions differ by at least ``threshold``."""
        while self._queue and self._queue[0][0] < threshold:
            _, a, b, version_a, version_b = heapq.heappop(self._queue)
            if (self._version[a], self._version[b]) == (version_a, version_b):
                kept = self._merge(a, b)
                self._push(kept, list(self._neighbors[kept]))

    def _push(self, number: int, others: list[int]) -> None:
        if not others:
            return
        weighed = self._differences(number, others) * self._size_weight(number, others)
        mine = self._version[number]
        for difference, other in zip(weighed.tolist(), others, strict=True):
            heapq.heappush(self._queue, (difference, number, other, mine, self._version[other]))

    def _differences(self, number: int, others: list[int]) -> Floats:
        """(K,) difference of a region to each of K neighbors [CIELAB]."""
        apart = np.abs(self._mean[others] - self._mean[number]).sum(axis=2)
        boundary = np.array([self._neighbors[number][other] for other in others])
        edge = boundary[:, 1] / boundary[:, 0]
        return np.sqrt(np.square(apart).sum(axis=1)) + self._options.edge_weight * edge

    def _size_weight(self, number: int, others: list[int]) -> Floats:
        """(K,) factors of the differences for the regions' sizes and common boundaries."""
        length = np.array([self._neighbors[number][other][0] for other in others])
        # As in Ward's criterion: about the smaller area if the areas differ much, half of it if they are equal.
        size = self._area[others] * self._area[number] / (self._area[others] + self._area[number])
        contact = length / np.minimum(self._outline[others], self._outline[number])
        size = (size / self._hundredth) ** self._options.size_power
        return size * (1 - self._options.contact_weight * contact)

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
        del self._neighbors[gone][kept], self._neighbors[kept][gone]
        mine = self._neighbors[kept]
        for other, (length, edge) in self._neighbors[gone].items():
            del self._neighbors[other][gone]
            known_length, known_edge = mine.get(other, (0.0, 0.0))
            mine[other] = self._neighbors[other][kept] = (known_length + length, known_edge + edge)
        self._neighbors[gone] = {}
        self._outline[kept] = _length(mine)
        return kept


def _length(neighbors: dict[int, tuple[float, float]]) -> float:
    """Total length of the boundaries to all neighbors [px]."""
    return sum(length for length, _ in neighbors.values())

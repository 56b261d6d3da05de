"""Find connected sets of Gaussians that match a query."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from egosplat.geometry import Array

# Number of neighbors of a Gaussian, itself included: a patch of about four by four on a surface.
NEAREST = 16

# Extent of a Gaussian in standard deviations: its weight there is about an eighth.
REACH = 2.0


@dataclass(frozen=True, eq=False)
class Neighbors:
    """The neighbors of N Gaussians.

    Attributes:
        touching: (N, N) sparse float32: 1 where one Gaussian is among the nearest of another and their extents (see
            ``REACH``) overlap; 1 on the diagonal.
    """

    touching: csr_array

    def averaging(self, weights: NDArray[np.float32]) -> csr_array:
        """The matrix that averages values over each Gaussian and its neighbors.

        Args:
            weights: (N,) non-negative weights of the Gaussians.

        Returns:
            (N, N) sparse float32 whose rows sum to 1, or to 0 where all weights are 0.
        """
        weights, touching = weights.astype(np.float32), self.touching
        total = touching @ weights
        inverse = np.divide(1.0, total, out=np.zeros_like(total), where=total > 0)
        # Products with diagonal matrices would sort all entries anew.
        values = np.repeat(inverse, np.diff(touching.indptr)) * weights[touching.indices]
        return csr_array((values, touching.indices, touching.indptr), shape=touching.shape)

    def components(self, members: NDArray[np.int64]) -> NDArray[np.int64]:
        """Label the connected components of a subset of the Gaussians.

        Args:
            members: (M,) indices, each once.

        Returns:
            (M,) int64 component of each member.
        """
        links = self.touching[members][:, members]
        return connected_components(links, directed=False)[1].astype(np.int64)


def find_neighbors(means: Array, radii: Array) -> Neighbors:
    """Find the neighbors of N Gaussians.

    Args:
        means: (N, 3) float64 centers.
        radii: (N,) float64 standard deviations along the longest axis, in the unit of the centers.
    """
    size, count = len(means), min(NEAREST, len(means))
    if not count:
        return Neighbors(csr_array((0, 0), dtype=np.float32))
    # A fixed number of neighbors adapts to the density; a radius would join everything in dense regions.
    tree = cKDTree(means)
    # In the order of the tree, so that each search finds in the processor's cache what the one before has read.
    order = tree.indices
    distance, nearest = tree.query(means[order], k=np.arange(1, count + 1), workers=-1)
    row, column = np.nonzero(distance <= REACH * (radii[order, None] + radii[nearest]))
    ones = np.ones(len(row), np.float32)
    return Neighbors(csr_array((ones, (order[row], nearest[row, column])), shape=(size, size)))


Floats = NDArray[np.float32]

# Minimum number of Gaussians of a thing: fewer are less than one neighborhood, where relevancy is noise.
LEAST_GAUSSIANS = 16

# Quantiles of a thing's box, weighted by visible share: single Gaussians far away do not enlarge it.
EXTENT = (0.02, 0.98)

# Two things are duplicates if they share more than this part of the smaller one's visible share.
SAME = 0.25


@dataclass(frozen=True, eq=False)
class Thing:
    """A connected set of Gaussians that match a query.

    Attributes:
        members: (M,) int64 indices of the Gaussians.
        level: index of the level at which they match.
        score: 0..1, see ``find_things``.
        view: index of the view that shows most of it, with pixels weighted towards the center; the first on ties.
        center: (3,) float64 mean of the Gaussians' centers, weighted by visible share, in world coordinates.
        low, high: (3,) float64 corners of its box along the world axes, see ``EXTENT``.
    """

    members: NDArray[np.int64]
    level: int
    score: float
    view: int
    center: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class Surface:
    """N Gaussians with their visibility in V views and their codes' shares at L levels.

    Attributes:
        means: (N, 3) float64 centers.
        shares: (V, N) float32 share of each view that a Gaussian fills, see
            ``egosplat.query.scene_query.visible_shares``.
        weight: (N, L) float32 mean of ``shares`` over the views, times the share of the Gaussian with a code.
        neighbors: the neighbors of the Gaussians.
        averaging: L matrices, see ``Neighbors.averaging``.
    """

    means: Array
    shares: Floats
    weight: Floats
    neighbors: Neighbors
    averaging: tuple[csr_array, ...]

    @staticmethod
    def of(means: Array, radii: Array, shares: Floats, code_share: Floats) -> "Surface":
        """Build the surface of N Gaussians.

        Args:
            means, radii: see ``find_neighbors``.
            shares: (V, N) float32, V at least 1.
            code_share: (N, L) float32 ``share`` of language.zarr.
        """
        return Surface.joined(means, find_neighbors(means, radii), shares, code_share)

    @staticmethod
    def joined(means: Array, neighbors: Neighbors, shares: Floats, code_share: Floats) -> "Surface":
        """Build the surface of N Gaussians whose neighbors are known; arguments as in ``of``."""
        weight = shares.mean(axis=0)[:, None] * code_share
        averaging = tuple(neighbors.averaging(level) for level in weight.T)
        return Surface(means, shares, weight, neighbors, averaging)


def find_things(
    surface: Surface, relevancy: Floats, threshold: float, box_side: float, most: int
) -> list[Thing]:
    """Find the things that match a query best (docs/method.md#scene-queries).

    This is LangSplat's segmentation on Gaussians instead of pixels. At each level, relevancy is averaged over
    neighbors, normalized to 0..1 and thresholded; the Gaussians above the threshold are split into connected
    components.

    Args:
        relevancy: (L, N) float32 in 0..1.
        threshold: threshold of the normalized relevancy, 0..1.
        box_side: side of the box filter, as a share of the image's side.
        most: maximum number of things.

    Returns:
        Things by decreasing score, without duplicates (see ``SAME``).
    """
    found = [
        _thing(surface, values, members, level, box_side)
        for level, values in enumerate(relevancy)
        for members in _parts(surface, values, level, threshold)
    ]
    kept: list[Thing] = []
    for thing in sorted(found, key=lambda one: -one.score):
        if len(kept) == most:
            break
        if not any(_same(thing, other, surface) for other in kept):
            kept.append(thing)
    return kept


def _parts(surface: Surface, values: Floats, level: int, threshold: float) -> list[NDArray[np.int64]]:
    """Members of each connected component above the threshold at a level; specks are left out."""
    seen = surface.weight[:, level] > 0
    if not seen.any():
        return []
    smooth = surface.averaging[level] @ values
    lowest, peak = smooth[seen].min(), smooth[seen].max()
    members = np.flatnonzero(seen & (smooth - lowest > threshold * (peak - lowest)))
    number = surface.neighbors.components(members)
    order = np.argsort(number, kind="stable")
    parts = np.split(members[order], np.flatnonzero(np.diff(number[order])) + 1)
    return [part for part in parts if len(part) >= LEAST_GAUSSIANS]


def _thing(
    surface: Surface, values: Floats, members: NDArray[np.int64], level: int, box_side: float
) -> Thing:
    weight, means = surface.weight[members, level].astype(np.float64), surface.means[members]
    total = weight.sum()
    shown = surface.shares[:, members].sum(axis=1, dtype=np.float64)
    view = int(shown.argmax())
    low, high = np.stack([_quantiles(axis, weight) for axis in means.T], axis=1)
    return Thing(
        members=members,
        level=level,
        # Mean relevancy times A / (A + a): A is the thing's share of its best view, a the share of LangSplat's box
        # filter. In an image, that filter lowers the peak of smaller things by the same factor.
        score=float(weight @ values[members] / total * shown[view] / (shown[view] + box_side**2)),
        view=view,
        center=weight @ means / total,
        low=low,
        high=high,
    )


def _quantiles(values: Array, weight: Array) -> Array:
    """(2,) weighted quantiles of (M,) values at ``EXTENT``."""
    order = np.argsort(values)
    below = np.cumsum(weight[order])
    places = np.searchsorted(below, np.array(EXTENT) * below[-1])
    return values[order[np.minimum(places, len(values) - 1)]]


def _same(one: Thing, other: Thing, surface: Surface) -> bool:
    common = np.intersect1d(one.members, other.members, assume_unique=True)
    shared, own, others = (
        surface.weight[rows].max(axis=1).sum() for rows in (common, one.members, other.members)
    )
    return bool(shared > SAME * min(own, others))

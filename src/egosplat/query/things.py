"""Connected things in 3D that fit a query."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from egosplat.geometry import Array

NEAREST = 16
"""Neighbours of a Gaussian, itself among them: a patch of a surface of some four by four."""

REACH = 2.0
"""Standard deviations up to which a Gaussian reaches: there its weight is down to an eighth."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Which of N Gaussians reach each other.

    Attributes:
        touching: (N, N) sparse float32: 1 where a Gaussian is among the nearest of another, and they reach each other, see
            ``REACH``; each touches itself.
    """

    touching: csr_array

    def averaging(self, weights: NDArray[np.float32]) -> csr_array:
        """The matrix that takes values to their weighted means over each Gaussian and its neighbours.

        Args:
            weights: (N,) at least 0.

        Returns:
            (N, N) sparse float32, whose rows have the sum 1; 0 where all weights are 0.
        """
        counted = self.touching @ diags_array(weights.astype(np.float32))
        total = counted.sum(axis=1)
        inverse = np.divide(1.0, total, out=np.zeros_like(total), where=total > 0)
        return csr_array(diags_array(inverse.astype(np.float32)) @ counted)

    def components(self, members: NDArray[np.int64]) -> NDArray[np.int64]:
        """Number the connected parts of some Gaussians.

        Args:
            members: (M,) indices, each once.

        Returns:
            (M,) int64 number of the part that each belongs to.
        """
        links = self.touching[members][:, members]
        return connected_components(links, directed=False)[1].astype(np.int64)


def find_neighbours(means: Array, radii: Array) -> Neighbours:
    """Find the neighbours of all Gaussians.

    Args:
        means: (N, 3) float64 centres.
        radii: (N,) float64 standard deviation of each along its longest axis, in the unit of the centres.
    """
    size, count = len(means), min(NEAREST, len(means))
    if not count:
        return Neighbours(csr_array((0, 0), dtype=np.float32))
    distance, nearest = cKDTree(means).query(means, k=np.arange(1, count + 1), workers=-1)
    row, column = np.nonzero(distance <= REACH * (radii[:, None] + radii[nearest]))
    ones = np.ones(len(row), np.float32)
    return Neighbours(csr_array((ones, (row, nearest[row, column])), shape=(size, size)))


Floats = NDArray[np.float32]

LEAST_GAUSSIANS = 16
"""Fewer Gaussians are less than one neighbourhood: what they mean is chance."""

EXTENT = (0.02, 0.98)
"""Quantiles, by visible share, between which a thing extends: single Gaussians far from it do not count."""

SAME = 0.25
"""Things that share a larger part of the smaller one's visible share are one thing, at two levels or of two sizes."""


@dataclass(frozen=True, eq=False)
class Thing:
    """A connected set of Gaussians that fit a query.

    Attributes:
        members: (M,) int64 indices of Gaussians.
        level: index of the level at which they fit.
        score: 0..1, see ``find_things``.
        view: index of the view that shows most of it, near the view's middle; the first of equal ones.
        centre: (3,) float64 mean of its centres by visible share, in the world.
        low, high: (3,) float64 corners of its box along the world's axes, see ``EXTENT``.
    """

    members: NDArray[np.int64]
    level: int
    score: float
    view: int
    centre: Array
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class Surface:
    """The Gaussians that can be asked, N of them, as V views show them at L levels.

    Attributes:
        means: (N, 3) float64 centres.
        shares: (V, N) float32 share of each view that each fills, see ``egosplat.query.scene_query.visible_shares``.
        weight: (N, L) float32 mean share of a view that each fills with something that has a code at the level.
        neighbours: which of them reach each other.
        averaging: L matrices, see ``Neighbours.averaging``.
    """

    means: Array
    shares: Floats
    weight: Floats
    neighbours: Neighbours
    averaging: tuple[csr_array, ...]

    @staticmethod
    def of(means: Array, radii: Array, shares: Floats, code_share: Floats) -> "Surface":
        """The surface of Gaussians.

        Args:
            means: (N, 3) float64 centres; radii: (N,) float64, see ``find_neighbours``.
            shares: (V, N) float32, V at least 1.
            code_share: (N, L) float32 share of language.zarr.
        """
        neighbours = find_neighbours(means, radii)
        weight = shares.mean(axis=0)[:, None] * code_share
        averaging = tuple(neighbours.averaging(level) for level in weight.T)
        return Surface(means, shares, weight, neighbours, averaging)


def find_things(
    surface: Surface, relevancy: Floats, threshold: float, box_side: float, most: int
) -> list[Thing]:
    """The things that fit a query best, told apart in 3D.

    At each level relevancy is smoothed over neighbours and brought to 0..1 between its lowest and largest value; what
    is above the threshold falls into connected parts. This is LangSplat's mask on Gaussians in place of pixels
    (docs/method.md#scene-queries).

    The score of a part is its mean relevancy, weighted by visible share, times A / (A + a): A is the share of the view
    that shows it best, a that of LangSplat's box filter. In a picture that filter does the same to what is smaller.

    Args:
        surface: what is asked.
        relevancy: (L, N) float32 in 0..1.
        threshold: of the smoothed relevancy, 0..1.
        box_side: side of the box filter, as a share of the picture's side.
        most: number of things at most.

    Returns:
        Things by falling score, no two of which are the same, see ``SAME``.
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
    """Members of each connected part of what fits at a level, specks left out."""
    seen = surface.weight[:, level] > 0
    if not seen.any():
        return []
    smooth = surface.averaging[level] @ values
    lowest, peak = smooth[seen].min(), smooth[seen].max()
    members = np.flatnonzero(seen & (smooth - lowest > threshold * (peak - lowest)))
    number = surface.neighbours.components(members)
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
        score=float(weight @ values[members] / total * shown[view] / (shown[view] + box_side**2)),
        view=view,
        centre=weight @ means / total,
        low=low,
        high=high,
    )


def _quantiles(values: Array, weight: Array) -> Array:
    """(2,) weighted quantiles ``EXTENT`` of (M,) values."""
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

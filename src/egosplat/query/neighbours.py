"""Which Gaussians lie next to each other."""

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

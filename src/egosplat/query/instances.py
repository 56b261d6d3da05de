"""The instance of each Gaussian."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from egosplat.artifacts.reader import Artifact
from egosplat.errors import UserError

# A Gaussian farther from every Gaussian that instances were merged on, in units of their median distance to these, is in
# no instance.
_FAR = 8.0


def instances_of_gaussians(instances: Artifact, means: NDArray[np.float32]) -> NDArray[np.int32]:
    """Give each of N > 0 Gaussians the instances of the nearest Gaussian that masks were merged on.

    Args:
        means: (N, 3) centers of the Gaussians.

    Returns:
        (L, N) int32 index of its instance at each level, -1 for none.

    Raises:
        UserError: the instances are tracks, which have no place in 3D.
    """
    xyz, owner = instances.read("gaussians/xyz"), instances.read("gaussians/instance")
    if not len(xyz):
        raise UserError(
            f"{instances.path}: its instances are tracks, which have no place in 3D; set instances.source to masks or both"
        )
    distance, nearest = cKDTree(xyz).query(means)
    return np.where((distance <= _FAR * np.median(distance))[:, None], owner[nearest], -1).T

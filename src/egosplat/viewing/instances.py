"""The instance of each Gaussian, for colors and for naming what is clicked."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from egosplat.artifacts.reader import Artifact
from egosplat.viewing.container import Arrays

# A Gaussian farther from every Gaussian that instances were merged on, in units of their median distance to these, is in
# no instance.
_FAR = 8.0


def pack_instances(instances: Artifact, means: NDArray[np.float32]) -> Arrays:
    """Give each Gaussian the instances of the nearest Gaussian that masks were merged on.

    Returns:
        ``instance`` (L, N) uint16: 0 for none, else 1 more than the instance's index; nothing if the instances are tracks, which
        have no place in 3D.
    """
    xyz, owner = instances.read("gaussians/xyz"), instances.read("gaussians/instance")
    if not len(xyz) or not len(means):
        return {}
    distance, nearest = cKDTree(xyz).query(means)
    owner = np.where((distance <= _FAR * np.median(distance))[:, None], owner[nearest], -1)
    return {"instance": (owner + 1).clip(0, 65535).astype(np.uint16).T}

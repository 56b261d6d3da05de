"""The instance of each Gaussian, for colors and for naming what is clicked."""

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact
from egosplat.query.instances import instances_of_gaussians
from egosplat.viewing.container import Arrays


def pack_instances(instances: Artifact, means: NDArray[np.float32]) -> Arrays:
    """Pack the instances of the Gaussians.

    Returns:
        ``instance`` (L, N) uint16: 0 for none, else 1 more than the instance's index; nothing if the instances are tracks, which
        have no place in 3D.
    """
    owner = instances_of_gaussians(instances, means)
    return {} if owner is None else {"instance": (owner + 1).clip(0, 65535).astype(np.uint16)}

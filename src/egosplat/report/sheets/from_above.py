"""What pages with a view from above share: which Gaussians it shows, and the colors of numbered things."""

import numpy as np
from matplotlib.colors import hsv_to_rgb
from numpy.typing import NDArray

from egosplat.artifacts.reader import Artifact

# Gaussians up to this share of the cameras' height above the floor are drawn from above: no ceiling hides the rest.
BELOW = 1.1


def below_cameras(poses: Artifact, xyz: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(G,) bool: which of the (G, 3) centers of Gaussians show the scene from above, without what is higher than the cameras."""
    up = poses.read("up")
    height = xyz @ up
    camera = np.median(poses.read("camera_to_world")[poses.read("registered"), :3, 3] @ up)
    # Stray Gaussians far outside would shrink the rest.
    low, high = np.percentile(xyz, [1, 99], axis=0)
    floor = np.percentile(height, 1)
    return ((xyz >= low) & (xyz <= high)).all(axis=1) & (height < floor + BELOW * (camera - floor))


def palette(count: int) -> NDArray[np.float64]:
    """(count, 3) colors in 0..1; consecutive ones have very different hues."""
    hues = (np.arange(count) * 0.61803398875) % 1.0
    value = 0.75 + 0.25 * ((np.arange(count) // 7) % 2)
    hsv = np.stack([hues, np.full(count, 0.85), value], axis=1)
    return hsv_to_rgb(hsv).reshape(count, 3)

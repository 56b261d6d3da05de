"""How far away what a camera sees is, by the points of its scene."""

import math

import numpy as np

from egosplat.geometry import Array, Camera, invert, transform

_FEWEST = 10
"""Points by which depth is told."""
_AT_ONCE = 50_000
"""Of more points, so many evenly among them are looked at."""


def seen_depths(camera: Camera, camera_to_world: Array, points: Array) -> Array:
    """(S,) float64 depths along the camera's axis of the points in its picture, whatever hides them [m].

    Args:
        camera_to_world: (4, 4).
        points: (P, 3) in the world [m].
    """
    some = points[:: math.ceil(len(points) / _AT_ONCE)] if len(points) > _AT_ONCE else points
    own = transform(invert(camera_to_world), some)
    return own[camera.contains(camera.project(own)), 2]


def depth_quantile(depths: Array, share: float) -> float | None:
    """The depth below which a share of some depths lies; None where too few are known [m]."""
    return float(np.quantile(depths, share)) if len(depths) >= _FEWEST else None

"""Choose the frames that add views: those whose view differs from the last frame kept."""

import math

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import Array, Camera, invert, rotation_angle, transform

Bools = NDArray[np.bool_]

# At least one frame is kept in every such interval: objects move while the head is still.
MAX_INTERVAL_S = 1.0

_MIN_POINTS = 10
_MAX_POINTS = 50_000


def visible_depths(camera: Camera, camera_to_world: Array, points: Array) -> Array:
    """Depths of the points inside the image, ignoring occlusion.

    Args:
        camera_to_world: (4, 4).
        points: (P, 3) in the world [m]; of more than 50,000 an even subset is used.

    Returns:
        (S,) float64 along the camera's axis [m].
    """
    subset = points[:: math.ceil(len(points) / _MAX_POINTS)] if len(points) > _MAX_POINTS else points
    in_camera = transform(invert(camera_to_world), subset)
    return in_camera[camera.contains(camera.project(in_camera)), 2]


def depth_quantile(depths: Array, share: float) -> float | None:
    """Quantile of depths [m]; None for fewer than 10 depths."""
    return float(np.quantile(depths, share)) if len(depths) >= _MIN_POINTS else None


def median_depths(camera: Camera, camera_to_world: Array, registered: Bools, points: Array) -> Array:
    """(F,) float64 median depth of the visible points of each frame [m]; NaN without a pose or enough points."""
    depths = np.full(len(registered), np.nan)
    for frame in np.flatnonzero(registered):
        median = depth_quantile(visible_depths(camera, camera_to_world[frame], points), 0.5)
        depths[frame] = np.nan if median is None else median
    return depths


def view_change(first: Array, second: Array, depth: float | Array) -> Array:
    """Upper bound of the angle by which points at a depth move in the view: rotation plus parallax [deg].

    Args:
        first, second: (..., 4, 4) camera_to_world, of shapes that broadcast.
        depth: number or (...), positive; inf counts the rotation only [m].

    Returns:
        (...) float64.
    """
    # A sum is an upper bound: rotation and parallax may partly cancel.
    relative = invert(first) @ second
    parallax = np.arctan2(np.linalg.norm(relative[..., :3, 3], axis=-1), depth)
    return np.degrees(rotation_angle(relative) + parallax)


def choose_views(
    camera_to_world: Array,
    depths: Array,
    times_ns: NDArray[np.int64],
    registered: Bools,
    optional: Bools,
    min_change_deg: float,
) -> Bools:
    """Drop optional frames whose view changed by less than ``min_change_deg`` since the last optional frame kept.

    Args:
        camera_to_world: (F, 4, 4) float64.
        depths: (F,) float64 of the scene [m]; NaN if unknown.
        times_ns: (F,) int64, increasing.
        registered: (F,) bool.
        optional: (F,) bool: frames that may be dropped.
        min_change_deg: 0 keeps all frames.

    Returns:
        (F,) bool: the frames that are kept.
    """
    kept = np.ones(len(registered), bool)
    # Without a pose or a depth nothing is known of a view, so the frame stays.
    candidates = np.flatnonzero(optional & registered & np.isfinite(depths))
    if min_change_deg <= 0 or not len(candidates):
        return kept
    last = candidates[0]
    # The last frame stays: later views are unknown.
    for frame in candidates[1:-1]:
        change = view_change(camera_to_world[last], camera_to_world[frame], depths[frame])
        overdue = times_ns[frame] - times_ns[last] >= MAX_INTERVAL_S * 1e9
        kept[frame] = change >= min_change_deg or overdue
        last = frame if kept[frame] else last
    return kept

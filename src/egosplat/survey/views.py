"""Which frames add views: those from which the scene looks otherwise than from the last one that was kept."""

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import Array, Camera, invert, rotation_angle
from egosplat.survey.depth import depth_quantile, seen_depths

Bools = NDArray[np.bool_]

LONGEST_S = 1.0
"""Of any such time one frame is kept at least: things move while a head is still."""


def view_change(one: Array, other: Array, depth: float) -> float:
    """How far what is seen at a depth moves in the view between two poses, at most [deg].

    The angle of the rotation and the parallax of the translation.

    Args:
        one, other: (4, 4) camera_to_world.
        depth: more than 0; inf leaves the rotation alone [m].
    """
    relative = invert(one) @ other
    parallax = np.arctan2(np.linalg.norm(relative[:3, 3]), depth)
    return float(np.degrees(rotation_angle(relative) + parallax))


def median_depths(camera: Camera, camera_to_world: Array, registered: Bools, points: Array) -> Array:
    """(F,) median depth of the points in each picture [m]; NaN where it has no pose or shows too few points."""
    depths = np.full(len(registered), np.nan)
    for frame in np.flatnonzero(registered):
        median = depth_quantile(seen_depths(camera, camera_to_world[frame], points), 0.5)
        depths[frame] = np.nan if median is None else median
    return depths


def choose_views(
    camera_to_world: Array,
    depths: Array,
    times_ns: NDArray[np.int64],
    registered: Bools,
    optional: Bools,
    least_deg: float,
) -> Bools:
    """(F,) the frames that are kept.

    A frame that may be left out is, where its view changed by less than ``least_deg`` from that of the last such frame
    that was kept. Frames without a pose or a depth stay, because nothing is known of their view, and the last one.

    Args:
        camera_to_world: (F, 4, 4). depths: (F,) of what is seen [m], NaN where not known.
        times_ns: (F,) increasing. registered: (F,).
        optional: (F,) frames that may be left out; 0 of ``least_deg`` leaves out none.
    """
    kept = np.ones(len(registered), bool)
    known = np.flatnonzero(optional & registered & np.isfinite(depths))
    if least_deg <= 0 or not len(known):
        return kept
    last = known[0]
    for frame in known[1:-1]:
        change = view_change(camera_to_world[last], camera_to_world[frame], depths[frame])
        # The next one would be too late.
        waited = times_ns[frame] - times_ns[last] >= LONGEST_S * 1e9
        kept[frame] = change >= least_deg or waited
        last = frame if kept[frame] else last
    return kept

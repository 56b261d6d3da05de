"""Choose the frames that add views, those whose view differs from the last frame kept, and the pairs that are compared."""

import math

import numpy as np

from egosplat.arrays import Array, Bools, Ints
from egosplat.geometry import Camera, invert, rotation_angle, transform

# At least one frame is kept in every such interval: objects move while the head is still.
MAX_INTERVAL_S = 1.0

# Fewer visible points do not tell a depth; of more, an even subset is used.
_MIN_POINTS, _MAX_POINTS = 10, 50_000

# Frames of a pair are this far apart, or as far as the next frame, up to a limit.
_INTERVAL_S, _MAX_INTERVAL_S = 0.2, 1.1
_MAX_PAIRS = 120
# In a long recording, pairs come in runs of consecutive ones: motion must be seen in three of them.
_RUN = 5
# Frames that show the same after this time, with at most this rotation and parallax, tell whether poses drift.
_REVISIT_S, _MAX_CHANGE_DEG, _MAX_REVISITS = 1.0, 35.0, 24
# Of more frames, an even subset is searched for revisits.
_MAX_SEARCHED = 400


def depth_quantile(camera: Camera, camera_to_world: Array, points: Array, share: float) -> float:
    """Quantile of the depths of the (P, 3) points inside an image, ignoring occlusion [m]; NaN for fewer than 10."""
    subset = points[:: math.ceil(len(points) / _MAX_POINTS)] if len(points) > _MAX_POINTS else points
    in_camera = transform(invert(camera_to_world), subset)
    depths = in_camera[camera.contains(camera.project(in_camera)), 2]
    return float(np.quantile(depths, share)) if len(depths) >= _MIN_POINTS else np.nan


def median_depths(camera: Camera, camera_to_world: Array, registered: Bools, points: Array) -> Array:
    """(F,) float64 median depth of the visible points of each frame [m]; NaN without a pose or enough points."""
    depths = np.full(len(registered), np.nan)
    for frame in np.flatnonzero(registered):
        depths[frame] = depth_quantile(camera, camera_to_world[frame], points, 0.5)
    return depths


def view_change(first: Array, second: Array, depth: float | Array) -> Array:
    """Upper bound of the angle by which points at a depth [m] move in the view: rotation plus parallax [deg].

    ``first``, ``second``: (..., 4, 4) camera_to_world, of shapes that broadcast with that of the depth.
    """
    # A sum is an upper bound: rotation and parallax may partly cancel.
    relative = invert(first) @ second
    parallax = np.arctan2(np.linalg.norm(relative[..., :3, 3], axis=-1), depth)
    return np.degrees(rotation_angle(relative) + parallax)


def choose_views(
    camera_to_world: Array, depths: Array, times_ns: Ints, optional: Bools, min_change_deg: float
) -> Bools:
    """(F,) bool: frames that are kept; ``optional`` ones only if the view changed since the last optional frame kept.

    ``depths`` are (F,) float64 of the scene [m], NaN if unknown, as without a pose; ``times_ns`` (F,) int64, increasing. The
    least change of the view is ``min_change_deg``; 0 keeps all frames.
    """
    kept = np.ones(len(depths), bool)
    # Without a depth nothing is known of a view, so the frame stays.
    candidates = np.flatnonzero(optional & np.isfinite(depths))
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


def choose_pairs(times_ns: Ints, registered: Bools) -> Ints:
    """(P, 2) int64 pairs of registered frames a short time apart, by the first, in runs evenly over the recording."""
    known = np.flatnonzero(registered)
    # Half a millisecond of tolerance: a camera's clock is not exact.
    later = np.searchsorted(times_ns[known], times_ns[known] + round((_INTERVAL_S - 5e-4) * 1e9))
    first = np.flatnonzero(later < len(known))
    pairs = np.stack([known[first], known[later[first]]], axis=1)
    pairs = pairs[np.diff(times_ns[pairs], axis=1)[:, 0] <= _MAX_INTERVAL_S * 1e9]
    if len(pairs) <= _MAX_PAIRS:
        return pairs
    runs, follower = _MAX_PAIRS // _RUN, {int(frame): row for row, frame in enumerate(pairs[:, 0])}
    chosen: set[int | None] = set()
    rows: list[int | None] = [len(pairs) * run // runs for run in range(runs)]
    for _ in range(_RUN):
        chosen.update(rows)
        rows = [None if row is None else follower.get(int(pairs[row, 1])) for row in rows]
    return pairs[sorted(row for row in chosen if row is not None)]


def choose_revisits(camera_to_world: Array, depths: Array, times_ns: Ints, limit: int) -> Ints:
    """(R, 2) int64 pairs of frames that show nearly the same at least a second apart, by the first, spread evenly.

    At most ``limit`` and 24. The other arguments are those of ``choose_views``.
    """
    known = np.flatnonzero(np.isfinite(depths))
    known = known[:: max(1, -(-len(known) // _MAX_SEARCHED))]
    chosen = []
    for part in np.array_split(known, max(1, min(limit, _MAX_REVISITS))):
        pairs = np.stack(np.meshgrid(part, known, indexing="ij"), axis=-1).reshape(-1, 2)
        pairs = pairs[times_ns[pairs[:, 1]] - times_ns[pairs[:, 0]] >= _REVISIT_S * 1e9]
        if limit < 1 or not len(pairs):
            continue
        before, after = camera_to_world[pairs].swapaxes(0, 1)
        change = view_change(before, after, depths[pairs[:, 0]])
        if change.min() <= _MAX_CHANGE_DEG:
            chosen.append(pairs[change.argmin()])
    return np.array(chosen, np.int64).reshape(-1, 2)

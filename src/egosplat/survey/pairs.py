"""Choose the pairs of frames that a survey compares."""

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import Array
from egosplat.survey.views import view_change

Bools = NDArray[np.bool_]
Pairs = NDArray[np.int64]

# Frames of a pair are this far apart, or as far as the next frame, up to a limit.
_INTERVAL_S, _MAX_INTERVAL_S = 0.2, 1.1
_MAX_PAIRS = 120
# In a long recording, pairs come in runs of consecutive ones: motion must be seen in two of them.
_RUN = 5
# Frames that show the same after this time, with at most this rotation and parallax, tell whether poses drift.
_REVISIT_S, _MAX_CHANGE_DEG, _MAX_REVISITS = 1.0, 35.0, 24
# Of more frames, an even subset is searched for revisits.
_MAX_SEARCHED = 400


def choose_pairs(times_ns: NDArray[np.int64], registered: Bools) -> Pairs:
    """Choose pairs of registered frames a short time apart, in runs that are spread evenly over the recording.

    Args:
        times_ns: (F,) int64, increasing.
        registered: (F,) bool.

    Returns:
        (P, 2) int64, ordered by the first frame.
    """
    known = np.flatnonzero(registered)
    # Half a millisecond of tolerance: a camera's clock is not exact.
    later = np.searchsorted(times_ns[known], times_ns[known] + round((_INTERVAL_S - 5e-4) * 1e9))
    first = np.flatnonzero(later < len(known))
    pairs = np.stack([known[first], known[later[first]]], axis=1)
    pairs = pairs[np.diff(times_ns[pairs], axis=1)[:, 0] <= _MAX_INTERVAL_S * 1e9]
    if len(pairs) <= _MAX_PAIRS:
        return pairs
    runs = _MAX_PAIRS // _RUN
    follower = {int(one): row for row, one in enumerate(pairs[:, 0])}
    chosen: set[int] = set()
    for part in range(runs):
        row: int | None = len(pairs) * part // runs
        for _ in range(_RUN):
            if row is None:
                break
            chosen.add(row)
            row = follower.get(int(pairs[row, 1]))
    return pairs[sorted(chosen)]


def choose_revisits(
    camera_to_world: Array, depths: Array, times_ns: NDArray[np.int64], registered: Bools, limit: int
) -> Pairs:
    """Choose pairs of frames that show nearly the same at least a second apart, spread evenly over the recording.

    Args:
        camera_to_world: (F, 4, 4) float64.
        depths: (F,) float64 of the scene [m]; NaN if unknown.
        times_ns: (F,) int64, increasing.
        registered: (F,) bool.
        limit: largest number of pairs; never more than 24.

    Returns:
        (P, 2) int64, ordered by the first frame.
    """
    known = np.flatnonzero(registered & np.isfinite(depths))
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

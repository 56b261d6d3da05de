"""Select frames of a recording by time and stride."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.frames.options import FramesOptions

# Value of ``frames.pick``.
SHARPEST = "sharpest"

# Longer times in nanoseconds overflow int64.
_MAX_S = 9e9


def select_frames(
    timestamp_ns: NDArray[np.int64], options: FramesOptions, source: Path, *, stride: int | None = None
) -> NDArray[np.int64]:
    """Select every ``stride``-th frame, by default of the options, of the time range start_s <= t < end_s.

    Args:
        timestamp_ns: (N,) int64, strictly increasing capture times of all frames.

    Returns:
        (F,) int64 indices into ``timestamp_ns``, F >= 1; the first frame of the range is one.

    Raises:
        UserError: the times do not increase, the range is empty, or no frame is in it.
    """
    start_s, end_s = options.start_s, options.end_s
    if end_s is not None and not end_s > start_s:
        raise UserError(f"end_s: {end_s} does not lie after start_s = {start_s}.")
    if not (np.diff(timestamp_ns) > 0).all():
        raise UserError(
            f"{source}: frames are not in order of time. Is the recording damaged? Copy it again."
        )
    # Relative to the first frame: devices count from their start or from 1970.
    elapsed_ns = timestamp_ns - timestamp_ns[0]
    in_range = elapsed_ns >= round(min(start_s, _MAX_S) * 1e9)
    if end_s is not None and end_s < _MAX_S:
        in_range &= elapsed_ns < round(end_s * 1e9)
    selected = np.flatnonzero(in_range)[:: stride or options.stride].astype(np.int64)
    if not len(selected):
        raise UserError(
            f"{source}: no frame between start_s and end_s; the last one is at {elapsed_ns[-1] * 1e-9:.3f} s."
        )
    return selected


def select_sharpest(frames: NDArray[np.int64], sharpness: Iterable[float], stride: int) -> NDArray[np.int64]:
    """Select the sharpest of every ``stride`` frames, the first of equally sharp ones: (ceil(N / stride),) int64.

    Args:
        frames: (N,) int64 numbers of consecutive frames.
        sharpness: of each of them; NaN, a frame without edges, is less than any other.
    """
    values = np.nan_to_num(np.fromiter(sharpness, np.float64, len(frames)), nan=-np.inf)
    best = [start + int(values[start : start + stride].argmax()) for start in range(0, len(frames), stride)]
    return frames[best]

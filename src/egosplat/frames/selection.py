"""Select frames of a recording by time, stride and sharpness, and split them into training and evaluation frames."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.frames.options import FramesOptions

# Values of ``frames.pick``, and of ``frames.evaluation_frames`` that derives the number from the recording.
SHARPEST, AUTO = "sharpest", "auto"

# Longer times in nanoseconds overflow int64.
_MAX_S = 9e9

_MIN_TRAINING_FRAMES = 2
# docs/method.md#evaluation-frames: 12 frames, or a sixth of a recording with fewer than 72.
_AUTO_EVALUATION_FRAMES, _FRAMES_PER_EVALUATION_FRAME = 12, 6


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
    """Select the sharpest of every ``stride`` of (N,) frames, the first of equally sharp ones; NaN is less than any other."""
    values = np.nan_to_num(np.fromiter(sharpness, np.float64, len(frames)), nan=-np.inf)
    best = [start + int(values[start : start + stride].argmax()) for start in range(0, len(frames), stride)]
    return frames[best]


def evaluation_count(wanted: int | str, count: int, annotated: bool, labeled: int | None = None) -> int:
    """Number of evaluation frames: the ``wanted`` one, or for ``auto`` by the frames and annotations of the recording.

    Args:
        labeled: number of frames that alone may be chosen; None if all may.
    """
    if wanted != AUTO:
        return int(wanted)
    if labeled is not None:
        return labeled
    # Without annotations there is no query to score, so every frame trains.
    auto = min(_AUTO_EVALUATION_FRAMES, max(1, count // _FRAMES_PER_EVALUATION_FRAME))
    return auto if annotated else 0


def split_frames(
    count: int, evaluation: int, holdout: bool, labeled: NDArray[np.int64] | None = None
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Choose the middle frame of each of ``evaluation`` equal parts of the recording for evaluation.

    Args:
        holdout: whether they are excluded from training; the paper does not say (docs/method.md#holdout).
        labeled: the frames that alone may be chosen, increasing: parts are then of these; None if all may.

    Returns:
        Two (count,) bool arrays: training frames, evaluation frames.

    Raises:
        UserError: there are too few frames for the split.
    """
    if count < _MIN_TRAINING_FRAMES:
        raise UserError(
            f"{count} frame is read, and training needs {_MIN_TRAINING_FRAMES} or more: add pictures, or take more of "
            "them (frames.stride, frames.start_s, frames.end_s)."
        )
    candidates = np.arange(count) if labeled is None else labeled
    if evaluation > len(candidates) and labeled is not None:
        raise UserError(
            f"frames.evaluation_frames: {evaluation} evaluation frames, but the recording labels {len(labeled)}; auto takes them all."
        )
    remaining = count - evaluation if holdout else count
    if evaluation > count or remaining < _MIN_TRAINING_FRAMES:
        raise UserError(
            f"frames.evaluation_frames: {evaluation} evaluation frames of {count} leave {max(remaining, 0)} for "
            f"training, which needs {_MIN_TRAINING_FRAMES}. Set a smaller number, or lower frames.stride."
        )
    is_evaluation = np.zeros(count, dtype=bool)
    # The middle of part i of count candidates is count (i + 1/2) / evaluation; integer arithmetic keeps it exact.
    middles = [len(candidates) * (2 * part + 1) // (2 * evaluation) for part in range(evaluation)]
    is_evaluation[candidates[middles]] = True
    return (~is_evaluation if holdout else np.ones(count, dtype=bool)), is_evaluation

"""Select frames of a recording by time and stride, and split them into training and evaluation frames."""

from pathlib import Path

import numpy as np

from egosplat.arrays import Bools, Ints
from egosplat.errors import UserError
from egosplat.frames.options import FramesOptions

# Longer times in nanoseconds overflow int64.
_MAX_S = 9e9

_MIN_TRAINING_FRAMES = 2
# docs/method.md#evaluation-frames: 12 frames, or a sixth of a recording with fewer than 72.
_AUTO_EVALUATION_FRAMES, _FRAMES_PER_EVALUATION_FRAME = 12, 6


def select_frames(timestamp_ns: Ints, options: FramesOptions, source: Path) -> Ints:
    """Indices, (F,) int64, of every ``stride``-th of (N,) times in the range start_s <= t < end_s, the first
    one included. UserError if the times do not increase, or no frame is in the range."""
    start_s, end_s = options.start_s, options.end_s
    if not (np.diff(timestamp_ns) > 0).all():
        raise UserError(f"{source}: frames are not in order of time. Copy the recording again.")
    # Relative to the first frame: devices count from their start or from 1970.
    elapsed_ns = timestamp_ns - timestamp_ns[0]
    in_range = elapsed_ns >= round(min(start_s, _MAX_S) * 1e9)
    if end_s is not None and end_s < _MAX_S:
        in_range &= elapsed_ns < round(end_s * 1e9)
    selected = np.flatnonzero(in_range)[:: options.stride].astype(np.int64)
    if not len(selected):
        last = f"the last one is at {elapsed_ns[-1] * 1e-9:.3f} s"
        raise UserError(f"{source}: no frame between frames.start_s and frames.end_s; {last}.")
    return selected


def split_frames(
    count: int, options: FramesOptions, annotated: bool, labeled: Ints | None = None
) -> tuple[Bools, Bools]:
    """Choose the middle frame of each of ``evaluation_frames`` equal parts of the recording for evaluation. ``annotated``: without
    annotations there is no query to score, so that auto lets every frame train. ``labeled``: the frames that alone may be chosen,
    increasing: parts are then of these; None if all may. Returns two (count,) bool arrays, training and evaluation frames;
    UserError if there are too few frames for the split."""
    if count < _MIN_TRAINING_FRAMES:
        more = "add pictures, or take more of them (frames.stride, frames.start_s, frames.end_s)"
        raise UserError(f"{count} frame is read, and training needs {_MIN_TRAINING_FRAMES} or more: {more}.")
    candidates, evaluation = np.arange(count) if labeled is None else labeled, options.evaluation_frames
    if evaluation == "auto":
        sixth = min(_AUTO_EVALUATION_FRAMES, max(1, count // _FRAMES_PER_EVALUATION_FRAME))
        evaluation = len(labeled) if labeled is not None else sixth if annotated else 0
    if labeled is not None and evaluation > len(labeled):
        raise UserError(f"frames.evaluation_frames: {evaluation}, but {len(labeled)} are labeled; set auto.")
    remaining = count - evaluation if options.holdout else count
    if evaluation > count or remaining < _MIN_TRAINING_FRAMES:
        lower = ", or lower frames.stride" if options.stride > 1 else ""
        raise UserError(
            f"frames.evaluation_frames: {evaluation} evaluation frames of {count} leave {max(remaining, 0)} for "
            f"training, which needs {_MIN_TRAINING_FRAMES}. Set a smaller number{lower}."
        )
    is_evaluation = np.zeros(count, dtype=bool)
    # The middle of part i of count candidates is count (i + 1/2) / evaluation; integer arithmetic keeps it exact.
    middles = [len(candidates) * (2 * part + 1) // (2 * evaluation) for part in range(evaluation)]
    is_evaluation[candidates[middles]] = True
    return (~is_evaluation if options.holdout else np.ones(count, dtype=bool)), is_evaluation

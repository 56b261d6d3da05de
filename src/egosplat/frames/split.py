"""Split frames into training and evaluation frames."""

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError

# Value of ``frames.evaluation_frames`` that derives the number from the recording.
AUTO = "auto"

_MIN_TRAINING_FRAMES = 2
# docs/method.md#evaluation-frames: 12 frames, or a sixth of a recording with fewer than 72.
_AUTO_EVALUATION_FRAMES, _FRAMES_PER_EVALUATION_FRAME = 12, 6


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
    if not annotated:
        return 0
    return min(_AUTO_EVALUATION_FRAMES, max(1, count // _FRAMES_PER_EVALUATION_FRAME))


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

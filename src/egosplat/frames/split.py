"""Which frames are trained on and which are evaluated."""

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError

AUTO = "auto"
"""Value of ``frames.evaluation_frames`` that leaves their number to the recording."""

_FEWEST_TRAINING_FRAMES = 2
_MOST_EVALUATION_FRAMES, _FRAMES_PER_EVALUATION_FRAME = 12, 6
"""Of ``auto``: 12 frames (docs/method.md#evaluation-frames), and of recordings with fewer than 72 frames a sixth."""


def evaluation_count(wanted: int | str, count: int, annotated: bool) -> int:
    """The number of evaluation frames of a recording.

    Args:
        wanted: the number that the user asks for, or ``auto``.
        count: number of frames.
        annotated: whether the recording has annotations. Without them the benchmark has no query, so ``auto``
            gives 0 and every frame is trained on.
    """
    if wanted != AUTO:
        return int(wanted)
    if not annotated:
        return 0
    return min(_MOST_EVALUATION_FRAMES, max(1, count // _FRAMES_PER_EVALUATION_FRAME))


def split_frames(count: int, evaluation: int, holdout: bool) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Pick evaluation frames at equal distances: the middle frame of each of ``evaluation`` equal parts.

    The ends are not favoured, unlike in sampling that begins with frame 0. Whether evaluation frames are
    also trained on is open in the paper (docs/method.md#holdout).

    Args:
        count: number of frames.
        evaluation: number of evaluation frames; 0 is allowed.
        holdout: whether evaluation frames are kept out of training.

    Returns:
        Two (count,) bool arrays: training frames, evaluation frames.

    Raises:
        UserError: fewer than two training frames or not enough frames would be left.
    """
    if evaluation < 0:
        raise UserError(f"frames.evaluation_frames: {evaluation} evaluation frames; 0 evaluates nothing.")
    remaining = count - evaluation if holdout else count
    if evaluation > count or remaining < _FEWEST_TRAINING_FRAMES:
        raise UserError(
            f"frames.evaluation_frames: {evaluation} evaluation frames of {count} leave {max(remaining, 0)} to train "
            f"on, at least {_FEWEST_TRAINING_FRAMES} are needed. Ask for fewer, or lower frames.stride."
        )
    is_evaluation = np.zeros(count, dtype=bool)
    # The middle of part i is count (i + 1/2) / evaluation; whole numbers keep it exact.
    is_evaluation[[count * (2 * part + 1) // (2 * evaluation) for part in range(evaluation)]] = True
    return (~is_evaluation if holdout else np.ones(count, dtype=bool)), is_evaluation

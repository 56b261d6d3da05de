"""Selection of frames, and their split into training and evaluation."""

from pathlib import Path

import numpy as np
import pytest

from egosplat.errors import UserError
from egosplat.frames.options import FramesOptions
from egosplat.frames.selection import select_frames, split_frames


@pytest.mark.parametrize(("count", "evaluation"), [(10, 2), (300, 7), (5, 3), (1000, 999 - 1), (9, 1)])
@pytest.mark.parametrize("holdout", [False, True])
def test_evaluation_frames_are_the_middles_of_equal_parts(count, evaluation, holdout):
    train, chosen = split_frames(count, FramesOptions(evaluation_frames=evaluation, holdout=holdout), True)
    indices = np.flatnonzero(chosen)
    assert len(indices) == evaluation
    middles = (np.arange(evaluation) + 0.5) * count / evaluation
    assert (np.abs(indices + 0.5 - middles) <= 0.5).all()
    # As much is left before the first as after the last, to a frame.
    assert abs(indices[0] - (count - 1 - indices[-1])) <= 1
    assert (train == (~chosen if holdout else True)).all()


@pytest.mark.parametrize(("count", "evaluation", "holdout"), [(10, 9, True), (10, 11, False)])
def test_a_split_that_leaves_too_little_is_rejected(count, evaluation, holdout):
    with pytest.raises(UserError, match="evaluation frames"):
        split_frames(count, FramesOptions(evaluation_frames=evaluation, holdout=holdout), True)


@pytest.mark.parametrize(("count", "expected"), [(120, 12), (72, 12), (48, 8), (17, 2), (5, 1)])
def test_auto_holds_out_frames_of_annotated_recordings_only(count, expected):
    assert split_frames(count, FramesOptions(), True)[1].sum() == expected
    assert not any(split_frames(each, FramesOptions(), False)[1].any() for each in (count, 2))


TIMES = 87_551_170_813_262 + np.array([0, 100, 200, 300, 400, 500]) * 1_000_000


def select(times=TIMES, **options):
    return select_frames(times, FramesOptions(**options), Path("recording")).tolist()


def test_selection_takes_the_range_then_the_stride():
    assert select() == select(end_s=1e300) == [0, 1, 2, 3, 4, 5]
    assert select(stride=4) == [0, 4]
    assert select(start_s=0.1) == [1, 2, 3, 4, 5]
    assert select(stride=2, start_s=0.1, end_s=0.5) == [1, 3]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start_s": 0.2, "end_s": 0.2}, "end_s"),
        ({"start_s": 0.51}, "no frame .* 0.500 s"),
        ({"times": TIMES[::-1]}, "order of time"),
    ],
)
def test_bad_selections_are_rejected(options, message):
    with pytest.raises(UserError, match=message):
        select(**options)

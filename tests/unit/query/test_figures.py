"""Rounded scores never contradict a verdict."""

import math

import pytest

from egosplat.query.grades import Grading


@pytest.mark.parametrize(
    "score, least, expected",
    [
        (0.7797, 0.78, "0.77"),
        (0.78, 0.78, "0.78"),
        (0.7835, 0.784, "0.78"),
        (0.7841, 0.784, "0.79"),
        (0.1, 0.78, "0.10"),
        (-1e-9, 0.0, "-0.01"),
        (math.nan, 0.5, "nan"),
        (math.inf, 0.5, "inf"),
        *(
            (score, least, None)
            for score in (0.77499, 0.7849, 0.785, 0.7851)
            for least in (0.0, 0.775, 0.785, 1.0)
        ),
    ],
)
def test_a_score_is_shown_on_the_side_of_the_least_score(score, least, expected):
    grading = Grading(None, least)
    shown = grading.shown(score)
    assert expected in (None, shown)
    assert (float(shown) >= least) == (score >= least) == (grading.refusal(score) is None)

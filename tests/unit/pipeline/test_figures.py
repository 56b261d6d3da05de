"""Rounded figures never contradict a verdict."""

import math

import pytest

from egosplat.pipeline.messages import figure
from egosplat.query.grades import Grading


@pytest.mark.parametrize(
    "value, limit, form, expected",
    [
        (0.7797, 0.78, ".2f", "0.77"),
        (0.78, 0.78, ".2f", "0.78"),
        (0.7801, 0.78, ".2f", "0.78"),
        (0.7835, 0.784, ".2f", "0.78"),
        (0.7841, 0.784, ".2f", "0.79"),
        (0.1, 0.78, ".2f", "0.10"),
        (0.89996, 0.9, ".1%", "89.9%"),
        (19.999, 20.0, ".2f", "19.99"),
        (1.4999, 1.5, ".2g", "1.4"),
        (0.99999, 1.0, ".0%", "99%"),
        (-1e-9, 0.0, ".2f", "-0.01"),
        (math.nan, 0.5, ".2f", "nan"),
        (math.inf, 0.5, ".2f", "inf"),
    ],
)
def test_a_figure_stays_on_its_side_of_the_limit(value, limit, form, expected):
    assert figure(value, form, lambda one: one < limit) == expected


@pytest.mark.parametrize("score", [0.77499, 0.7797, 0.78, 0.7849, 0.785, 0.7851, 0.79])
@pytest.mark.parametrize("least", [0.0, 0.775, 0.78, 0.785, 1.0])
def test_a_score_is_shown_on_the_side_of_the_least_score(score, least):
    grading = Grading(None, least)
    refused = grading.refusal(score) is not None
    assert (float(grading.shown(score)) < least) == refused == (score < least)

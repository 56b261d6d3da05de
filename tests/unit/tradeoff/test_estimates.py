"""Means, differences and ratios of a few runs, and the front."""

import math

import pytest
from scipy import stats

from egosplat.tradeoff.estimates import Estimate, Sample, difference, front, mean, ratio

LEFT, RIGHT = Sample((3.0, 3.4, 3.1)), Sample((2.0, 2.6))


def test_a_mean_has_students_interval():
    found = mean(LEFT, 0.9)
    expected = stats.ttest_1samp(LEFT.values, 0.0).confidence_interval(0.9)
    assert found.value == pytest.approx(9.5 / 3)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))


def test_a_difference_has_welchs_interval():
    found = difference(LEFT, RIGHT, 0.95)
    expected = stats.ttest_ind(LEFT.values, RIGHT.values, equal_var=False).confidence_interval(0.95)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))


def test_a_ratio_is_a_difference_of_logarithms():
    found = ratio(Sample((2.0, 8.0)), Sample((1.0, 1.0)), 0.95)
    assert found.value == pytest.approx(4.0)
    assert found.low * found.high == pytest.approx(16.0)
    assert ratio(LEFT, LEFT, 0.95).value == pytest.approx(1.0)


@pytest.mark.parametrize("compare", [difference, ratio])
def test_one_run_tells_nothing_of_chance(compare):
    found = compare(Sample((2.0,)), LEFT, 0.95)
    assert found.low is None and found.high is None and not found.excludes(-100.0)
    assert mean(Sample((2.0,)), 0.95) == Estimate(2.0)


def test_equal_runs_are_equal_up_to_a_step():
    exact, coarse = Sample((0.5, 0.5)), Sample((0.5, 0.5), step=0.0125)
    assert mean(exact, 0.95) == Estimate(0.5, 0.5, 0.5)
    assert mean(coarse, 0.95).low < 0.5 - 0.0125
    near = Sample((0.5125, 0.5125), step=0.0125)
    assert not difference(near, coarse, 0.95).excludes(0.0)
    assert difference(Sample((0.8, 0.8), step=0.0125), coarse, 0.95).excludes(0.0)
    assert difference(exact, exact, 0.95) == Estimate(0.0, 0.0, 0.0)


def test_intervals_hold_the_truth_as_often_as_they_say():
    import numpy as np

    rng = np.random.default_rng(0)
    trials = [difference(Sample(tuple(a)), Sample(tuple(b)), 0.9) for a, b in rng.normal(size=(2000, 2, 3))]
    assert 0.86 < sum(not one.excludes(0.0) for one in trials) / 2000 < 0.95


@pytest.mark.parametrize(
    "points, expected",
    [
        ([], []),
        ([(1.0, 0.5)], [0]),
        ([(2.0, 0.5), (1.0, 0.4), (3.0, 0.45)], [1, 0]),
        ([(1.0, 0.4), (1.0, 0.5)], [1]),
        ([(1.0, 0.5), (2.0, 0.5)], [0]),
        ([(1.0, 0.5), (1.0, 0.5)], [0, 1]),
        ([(3.0, 0.9), (2.0, 0.8), (1.0, 0.7)], [2, 1, 0]),
        ([(1.0, 0.5), (2.0, math.inf)], [0, 1]),
    ],
)
def test_the_front_is_what_nothing_else_beats(points, expected):
    assert front(points) == expected

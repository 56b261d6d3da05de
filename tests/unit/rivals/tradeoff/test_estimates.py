"""Means of a few runs, and the front."""

import math

import numpy as np
import pytest
from scipy import stats

from egosplat_rivals.tradeoff.estimates import Estimate, estimate_mean, find_front, pool

LEFT, RIGHT = (3.0, 3.4, 3.1), (2.0, 2.6)
BOTH = pool([LEFT, RIGHT])


def test_a_mean_of_one_point_alone_has_students_interval():
    found = estimate_mean(LEFT, pool([LEFT]), 0.9)
    expected = stats.ttest_1samp(LEFT, 0.0).confidence_interval(0.9)
    assert found.mean == pytest.approx(9.5 / 3)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))


def test_chance_is_estimated_within_settings():
    far = tuple(value + 100.0 for value in RIGHT)
    residuals = np.concatenate([np.subtract(one, np.mean(one)) for one in (LEFT, far)])
    assert pool([LEFT, far]).freedom == 3
    assert pool([LEFT, far]).variance == pytest.approx((residuals**2).sum() / 3)
    assert pool([LEFT, far, (7.0,)]).variance == pytest.approx(BOTH.variance)


def test_shared_runs_count_once():
    assert pool([LEFT, LEFT, RIGHT]) == BOTH
    assert pool([(0.5, 0.6), (0.5, 0.6)], step=0.01).freedom == 2


def test_a_positive_mean_has_the_bounds_of_a_ratio():
    """The interval of a cost is symmetric in its logarithm."""
    logarithms = (math.log(2.0), math.log(8.0))
    around = estimate_mean((2.0, 8.0), pool([logarithms, (0.0, 0.0)]), 0.95, logarithmic=True)
    assert around.mean == 5.0 and around.low * around.high == pytest.approx(25.0)


def test_no_interval_without_repeats():
    chance = pool([(2.0,), (2.0,)])
    assert chance.freedom == 0
    for logarithmic in (False, True):
        assert estimate_mean((2.0,), chance, 0.95, logarithmic) == Estimate(2.0)


def test_a_point_that_was_run_once_is_judged_by_the_others():
    """A single run takes the variance from the points that were run several times."""
    found = estimate_mean((2.0,), BOTH, 0.95)
    half = stats.t.ppf(0.975, 3) * math.sqrt(BOTH.variance)
    assert found.high - found.mean == pytest.approx(half)


def test_equal_runs_have_an_interval_of_one_step():
    equal = (0.5, 0.5)
    assert estimate_mean(equal, pool([equal]), 0.95) == Estimate(0.5, 0.5, 0.5)
    assert estimate_mean(equal, pool([equal, equal], step=0.0125), 0.95).low < 0.5 - 0.0125 / 2


def test_intervals_cover_the_truth_at_their_confidence():
    rng = np.random.default_rng(0)
    points = [[tuple(runs) for runs in trial] for trial in rng.normal(size=(2000, 6, 2)).tolist()]
    found = [estimate_mean(trial[0], pool(trial), 0.9) for trial in points]
    assert 0.88 < sum(one.low <= 0.0 <= one.high for one in found) / 2000 < 0.92


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
def test_the_pareto_front_is_not_dominated(points, expected):
    assert find_front(points) == expected

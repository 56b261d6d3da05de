"""Confidence intervals."""

import math

import numpy as np
import pytest

from egosplat.benchmark.intervals import IntervalOptions, bootstrap_interval, wilson_interval

OPTIONS = IntervalOptions(confidence=0.95, resamples=2000, seed=0)


@pytest.mark.parametrize("hits, count", [(3, 10), (0, 10), (10, 10), (57, 163)])
def test_wilsons_formula(hits, count):
    z, share = 1.959964, hits / count
    middle = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z / (1 + z**2 / count) * math.sqrt(share * (1 - share) / count + z**2 / (4 * count**2))
    found = wilson_interval(hits, count, 0.95)
    assert (found.low, found.high) == pytest.approx((middle - half, middle + half), abs=1e-6)


def test_of_a_normal_mean_the_bootstrap_is_the_normal_interval():
    values = np.random.default_rng(1).normal(0.4, 0.1, 400)
    found, half = bootstrap_interval(values, OPTIONS), 1.96 * values.std() / 20
    assert (found.low, found.high) == pytest.approx(
        (values.mean() - half, values.mean() + half), abs=0.1 * half
    )


def test_it_repeats_with_its_seed_and_only_then():
    values = np.random.default_rng(1).random(30)
    other = IntervalOptions(confidence=0.95, resamples=2000, seed=1)
    assert bootstrap_interval(values, OPTIONS) == bootstrap_interval(values, OPTIONS)
    assert bootstrap_interval(values, OPTIONS) != bootstrap_interval(values, other)


def test_the_more_confident_the_wider():
    values = np.random.default_rng(1).random(30)
    sure, unsure = (bootstrap_interval(values, IntervalOptions(c, 2000, 0)) for c in (0.99, 0.5))
    assert sure.low < unsure.low < values.mean() < unsure.high < sure.high


def test_equal_values_leave_no_doubt():
    found = bootstrap_interval(np.full(7, 0.25), OPTIONS)
    assert (found.low, found.high) == (0.25, 0.25)


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_values(count):
    found = bootstrap_interval(np.full(count, 0.5), OPTIONS)
    assert math.isnan(found.low) and math.isnan(found.high)
    assert math.isnan(wilson_interval(0, 0, 0.95).low)

"""Intervals over categories and scenes, and McNemar's test."""

import numpy as np
import pytest

from benchmarks.scores import mcnemar
from egosplat.evaluation.intervals import (
    Clusters,
    IntervalOptions,
    cluster,
    clustered_interval,
    mean_of_scenes,
)

OPTIONS = IntervalOptions(confidence=0.95, resamples=2000, seed=0)


def hits_of(rng: np.random.Generator, share: float, categories: int = 22, frames: int = 4) -> Clusters:
    """Categories that are hit in all of their frames, or in none."""
    found = rng.random(categories) < share
    return cluster(np.repeat(found, frames), np.repeat([f"thing {n}" for n in range(categories)], frames))


def covered(scenes, truth: float) -> bool:
    interval = clustered_interval(scenes, IntervalOptions(confidence=0.95, resamples=500, seed=0))
    return interval.low <= truth <= interval.high


def test_values_are_summed_by_category():
    found = cluster([True, False, True, True], ["cup", "couch", "cup", "couch"])
    assert (found.totals.tolist(), found.counts.tolist(), found.mean) == ([1.0, 2.0], [2.0, 2.0], 0.75)
    assert np.isnan(cluster([], []).mean)


def test_categories_that_are_hit_together_are_covered_as_often_as_said():
    """The interval over queries, which takes them for independent, covers far too rarely."""
    rng = np.random.default_rng(3)
    clustered = naive = 0
    for _ in range(300):
        scene = hits_of(rng, 0.55)
        clustered += covered([scene], 0.55)
        alone = Clusters(np.repeat(scene.totals / scene.counts, 4), np.ones(4 * len(scene.counts)))
        naive += covered([alone], 0.55)
    assert 0.92 <= clustered / 300 <= 0.98 and naive / 300 < 0.75


@pytest.mark.parametrize("spread", [0.0, 0.15])
def test_means_over_scenes_are_covered_as_often_as_said(spread):
    rng, found = np.random.default_rng(5), 0
    for _ in range(300):
        shares = np.clip(rng.normal(0.5, spread, 5), 0, 1)
        found += covered([hits_of(rng, share) for share in shares], 0.5)
    assert 0.92 <= found / 300


def test_a_category_weighs_as_much_as_it_has_queries():
    counts = np.array([30.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    scene = Clusters(np.array([15.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0]), counts)
    even = Clusters(scene.totals / counts, np.ones(7))
    own, other = (clustered_interval([one], OPTIONS) for one in (scene, even))
    assert scene.mean == 0.5 and own.high - own.low < other.high - other.low


def test_two_categories_leave_the_doubt_of_two_numbers():
    """All resamples lie between the two numbers, which the truth often does not: Student's interval is far wider."""
    found = clustered_interval([Clusters(np.array([0.48, 0.52]), np.ones(2))], OPTIONS)
    half = 12.706 * 0.04 / 2
    assert (found.low, found.high) == pytest.approx((0.5 - half, 0.5 + half), rel=0.03)
    far = clustered_interval([Clusters(np.array([0.0, 4.0]), np.full(2, 4.0))], OPTIONS)
    assert (far.low, far.high) == (0.0, 1.0)


@pytest.mark.parametrize("hit", [0.0, 1.0])
def test_all_hit_or_all_missed_leaves_the_doubt_of_so_many_categories(hit):
    found = clustered_interval([Clusters(np.full(22, 4 * hit), np.full(22, 4.0))], OPTIONS)
    doubt = 1.959964**2 / (22 + 1.959964**2)
    expected = (1 - doubt, 1.0) if hit else (0.0, doubt)
    assert (found.low, found.high) == pytest.approx(expected, abs=1e-6)
    # Of differences, which may be below 0 as well.
    found = clustered_interval([Clusters(np.zeros(22), np.full(22, 4.0))], OPTIONS, least=-1.0)
    assert (found.low, found.high) == pytest.approx((-doubt, doubt), abs=1e-6)


def test_scenes_without_queries_are_ignored_and_a_single_category_has_no_interval():
    scene, empty = Clusters(np.array([1.0, 0.0]), np.array([1.0, 3.0])), cluster([], [])
    assert mean_of_scenes([scene, empty]) == 0.25 and np.isnan(mean_of_scenes([empty]))
    assert clustered_interval([scene, empty], OPTIONS) == clustered_interval([scene], OPTIONS)
    for scenes in ([Clusters(np.ones(1), np.full(1, 5.0))], [empty], []):
        assert clustered_interval(scenes, OPTIONS) is None


@pytest.mark.parametrize(
    "gained, lost, p", [(0, 0, 1.0), (5, 5, 1.0), (0, 6, 2 / 2**6), (8, 1, 2 * 10 / 2**9)]
)
def test_mcnemars_exact_p(gained, lost, p):
    assert mcnemar(gained, lost) == pytest.approx(p) and mcnemar(lost, gained) == pytest.approx(p)

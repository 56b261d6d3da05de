"""Intervals over categories and scenes."""

import numpy as np
import pytest

from egosplat.evaluation.intervals import Clusters, cluster, clustered_interval, mean_of_scenes

RESAMPLES = 2000


def hits_of(rng: np.random.Generator, share: float, categories: int = 22, frames: int = 4) -> Clusters:
    found = rng.random(categories) < share
    return cluster(np.repeat(found, frames), np.repeat([f"thing {n}" for n in range(categories)], frames))


def covered(scenes, truth: float) -> bool:
    interval = clustered_interval(scenes, 500)
    return interval[0] <= truth <= interval[1]


@pytest.mark.parametrize("scenes, spread", [(1, 0.0), (5, 0.0), (5, 0.15)])
def test_means_are_covered_as_often_as_said(scenes, spread):
    """The interval over queries, which takes them for independent, covers a scene far too rarely."""
    rng, clustered, naive = np.random.default_rng(3), 0, 0
    for _ in range(300):
        drawn = [hits_of(rng, share) for share in np.clip(rng.normal(0.55, spread, scenes), 0, 1)]
        clustered += covered(drawn, 0.55)
        alone = Clusters(np.repeat(drawn[0].totals / drawn[0].counts, 4), np.ones(4 * 22))
        naive += scenes == 1 and covered([alone], 0.55)
    assert 0.92 <= clustered / 300 and naive / 300 < 0.75


def test_two_categories_leave_the_doubt_of_two_numbers():
    found = clustered_interval([Clusters(np.array([0.48, 0.52]), np.ones(2))], RESAMPLES)
    half = 12.706 * 0.04 / 2
    assert found == pytest.approx((0.5 - half, 0.5 + half), rel=0.03)
    far = clustered_interval([Clusters(np.array([0.0, 4.0]), np.full(2, 4.0))], RESAMPLES)
    assert far == (0.0, 1.0)


@pytest.mark.parametrize("hit", [0.0, 1.0])
def test_all_hit_or_all_missed_leaves_the_doubt_of_so_many_categories(hit):
    found = clustered_interval([Clusters(np.full(22, 4 * hit), np.full(22, 4.0))], RESAMPLES)
    doubt = 1.959964**2 / (22 + 1.959964**2)
    assert found == pytest.approx((1 - doubt, 1.0) if hit else (0.0, doubt), abs=1e-6)


def test_scenes_without_queries_are_ignored_and_a_single_category_has_no_interval():
    scene, empty = Clusters(np.array([1.0, 0.0]), np.array([1.0, 3.0])), cluster([], [])
    assert mean_of_scenes([scene, empty]) == 0.25 and np.isnan(mean_of_scenes([empty]))
    assert clustered_interval([scene, empty], RESAMPLES) == clustered_interval([scene], RESAMPLES)
    for scenes in ([Clusters(np.ones(1), np.full(1, 5.0))], [empty], []):
        assert clustered_interval(scenes, RESAMPLES) is None

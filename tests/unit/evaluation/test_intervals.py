"""Intervals over categories and scenes, and the test of paired differences."""

from itertools import product

import numpy as np
import pytest

from benchmarks.intervals.differences import paired_difference
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


def p_by_hand(scenes: list[Clusters], supposed: float) -> float:
    """Share of all flips of signs whose mean of scenes is as far from zero as the observed one, less what is supposed."""
    own = [(each.totals - supposed * each.counts) / each.counts.sum() / len(scenes) for each in scenes]
    signs = np.array([*product((1, -1), repeat=sum(map(len, own)))])
    means = np.abs(signs @ np.concatenate(own))
    return float(np.mean(means >= means[0] - 1e-12))


@pytest.mark.parametrize("ties", [True, False])
def test_an_interval_has_the_differences_that_flips_of_signs_do_not_reject(ties):
    rng = np.random.default_rng(7)
    for _ in range(60):
        sizes = [rng.integers(1, 6, rng.integers(1, 4)).astype(float) for _ in range(rng.integers(2, 4))]
        means = [rng.integers(-1, 2, len(own)) if ties else rng.uniform(-0.4, 1, len(own)) for own in sizes]
        scenes = [Clusters(own * mean, own) for own, mean in zip(sizes, means, strict=True)]
        if np.ptp(np.concatenate([each.totals / each.counts for each in scenes])) == 0:
            continue
        found = paired_difference(scenes, RESAMPLES)
        assert (found.p, found.mean) == pytest.approx((p_by_hand(scenes, 0.0), mean_of_scenes(scenes)))
        for supposed in (0.0, *rng.uniform(-1, 1, 5), found.interval[0] + 1e-6, found.interval[1] - 1e-6):
            inside = found.interval[0] <= supposed <= found.interval[1]
            assert inside == (p_by_hand(scenes, supposed) >= 0.05)


@pytest.mark.parametrize(
    "categories, difference, p, low",
    [
        (0, 1.0, 1.0, -1.0),
        (1, 1.0, 1.0, -1.0),
        (5, 1.0, 1 / 16, -1.0),
        (6, 1.0, 1 / 32, 0.219331),
        (22, 0.0, 1.0, -0.148655),
        (22, 1.0, 1 / 2000, 0.702690),
        (22, 0.1, 0.138011, -0.063520),
    ],
)
def test_equal_differences_leave_the_doubt_of_so_many_categories(categories, difference, p, low):
    """Five categories or fewer reject nothing; without spread, no more is known than of scores without it."""
    alike = Clusters(np.full(categories, 4 * difference), np.full(categories, 4.0))
    found = paired_difference([alike, cluster([], [])], RESAMPLES)
    assert (found.p, found.interval[0]) == pytest.approx((p, low), abs=1e-6) and found.over_scenes is None
    opposite = paired_difference([Clusters(-alike.totals, alike.counts)], RESAMPLES)
    assert (opposite.p, opposite.interval[1]) == (found.p, -found.interval[0])


def test_clustered_differences_of_nothing_are_rejected_as_rarely_as_said():
    rng, found = np.random.default_rng(9), []
    for _ in range(300):
        scenes = [Clusters(4.0 * rng.choice([-1, 0, 0, 1], 22), np.full(22, 4.0)) for _ in range(2)]
        found.append(paired_difference(scenes, RESAMPLES))
    assert 0.02 <= np.mean([each.p < 0.05 for each in found]) <= 0.075
    assert all((each.p >= 0.05) == (each.interval[0] <= 0 <= each.interval[1]) for each in found)
    # The same on every processor: a share of 2,000 flips, and means of categories.
    assert found[0][1:] == ((0.052631579, 0.476190476), 0.022, None)


def test_scenes_that_differ_have_students_interval_beside():
    means, spread = np.array([0.1, 0.3, 0.5, 0.2, 0.4]), np.tile([0.4, -0.4], 4)
    scenes = [Clusters(4 * mean + spread, np.full(8, 4.0)) for mean in means]
    half = 2.776445 * np.std(means, ddof=1) / np.sqrt(5)
    found = paired_difference(scenes, RESAMPLES)
    assert found.over_scenes == pytest.approx((0.3 - half, 0.3 + half), abs=1e-6)
    assert found.over_scenes[0] < found.interval[0] < found.interval[1] < found.over_scenes[1]
    assert paired_difference(scenes[:1] * 5, RESAMPLES).over_scenes is None

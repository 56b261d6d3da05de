"""Tests of paired differences, and of the measure of how often intervals hold the truth."""

from itertools import product

import numpy as np
import pytest

from benchmarks.intervals import __main__ as intervals
from benchmarks.intervals.differences import paired_difference
from egosplat.evaluation.intervals import Clusters, cluster, mean_of_scenes

RESAMPLES = 2000


def test_categories_have_one_value_in_all_of_their_frames():
    (scene,) = intervals.draw(np.random.default_rng(0), [0, 1], np.array([[0.5, 0.5]]), 50)
    assert set(scene.totals) == {0.0, intervals.FRAMES} and set(scene.counts) == {intervals.FRAMES}
    assert 0.3 < scene.mean < 0.7


def test_a_row_has_how_often_each_interval_holds_the_truth():
    """Those over categories far more often than those over queries, which are far narrower."""
    cells = [float(cell) for cell in intervals.score_row(1, 22, 0.55, 0.0, trials=60)]
    assert cells[:4] == [1, 22, 0.55, 0]
    held, width, naive_held, naive_width = cells[4:]
    assert held >= 0.85 > naive_held + 0.05 and width > 1.8 * naive_width


def test_a_row_has_how_often_no_difference_is_rejected():
    """By flips as rarely as their interval misses it, by queries far more often; t intervals of scenes that differ are wider."""
    cells = [float(cell) for cell in intervals.difference_row(5, 22, 0.3, 0.1, trials=60)]
    rejected, naive, held, width, *student = cells[4:]
    assert naive > 0.3 > rejected and held == 1 - rejected and student[0] > held and student[1] > width


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

"""Merging of runs: the fast way against one that compares all runs anew after each merge."""

import numpy as np
import pytest

from egosplat.instances.merging import Runs, agglomerate, overlaps
from egosplat.instances.options import InstancesOptions


def make_runs(count: int, gaussians: int, seed: int) -> tuple[Runs, np.ndarray]:
    """Noisy runs of a few things on a line of Gaussians, and the Gaussians' weights."""
    rng = np.random.default_rng(seed)
    seen = np.where(rng.random((count, gaussians)) < 0.5, 3 * rng.random((count, gaussians)), 0.0)
    votes, centers = np.zeros_like(seen), rng.integers(0, gaussians, max(1, count // 5))
    for run in range(count):
        first = max(0, centers[rng.integers(len(centers))] + rng.integers(-4, 5))
        mine = slice(first, first + rng.integers(15, 30))
        votes[run, mine] = seen[run, mine] * rng.random(seen[run, mine].shape) ** 0.2
    weight = rng.random(gaussians).astype(np.float32)
    return Runs(votes.astype(np.float32), seen.astype(np.float32), 0.5), weight


def agglomerate_slowly(runs: Runs, weight: np.ndarray, least: float) -> np.ndarray:
    """Merge the most alike two, comparing all runs that are left with each other every time."""
    into, gone = np.arange(len(runs.votes)), np.zeros(len(runs.votes), bool)
    while True:
        iou = np.nan_to_num(overlaps(runs, weight))
        np.fill_diagonal(iou, 0.0)
        iou[gone] = iou[:, gone] = 0.0
        one, other = sorted(np.unravel_index(iou.argmax(), iou.shape))
        if iou[one, other] < least:
            return into
        runs.add(one, other)
        into[into == other], gone[other] = one, True


@pytest.mark.parametrize("merge_iou", [0.1, 0.4, 1.0])
@pytest.mark.parametrize("count", [1, 2, 40])
@pytest.mark.parametrize("seed", [0, 1])
def test_merges_are_those_of_comparing_all_runs_anew(count, merge_iou, seed):
    expected = agglomerate_slowly(*make_runs(count, 300, seed), merge_iou)
    found = agglomerate(*make_runs(count, 300, seed), InstancesOptions(merge_iou=merge_iou))
    np.testing.assert_array_equal(found, expected)
    if count == 40 and merge_iou < 1:
        assert 1 < len(np.unique(found)) < count


def test_equal_runs_merge_and_runs_without_a_gaussian_stay_apart():
    seen = np.ones((4, 6), np.float32)
    votes = np.array([[1, 1, 0, 0, 0, 0], [0] * 6, [1, 1, 0, 0, 0, 0], [0] * 6], np.float32)
    found = agglomerate(Runs(votes, seen, 0.5), np.ones(6, np.float32), InstancesOptions())
    assert found.tolist() == [0, 1, 0, 3]

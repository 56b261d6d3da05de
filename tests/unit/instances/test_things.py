"""Masks become one instance if they hold the same of what their frames have both seen."""

import numpy as np
import pytest
from scipy import sparse

from egosplat.instances.merging import Runs, agglomerate
from egosplat.instances.things import beliefs, find_things
from tests.unit.instances.conftest import lifted

TABLE, CUP, WALL = [0, 1, 2, 3], [4, 5], [6, 7, 8, 9]
ALL = [*TABLE, *CUP, *WALL]


def things(masks) -> list[int]:
    """The instance of each mask."""
    weight = np.ones(masks.seen.shape[1], np.float32)
    return find_things(masks, weight)[0].tolist()


@pytest.mark.parametrize(
    ("held", "frames", "seen", "expected"),
    [
        ([TABLE, CUP, TABLE, CUP, CUP], [0, 0, 1, 1, 2], [ALL] * 3, [0, 1, 0, 1, 1]),
        # Compared is what both frames have seen: what leaves the picture is the same thing as its visible part.
        ([TABLE, TABLE[:2], WALL], [0, 1, 1], [ALL, [*TABLE[:2], *WALL]], [0, 0, 1]),
        ([TABLE, CUP] * 37, np.repeat(np.arange(37), 2).tolist(), [ALL] * 37, [0, 1] * 37),
    ],
)
def test_masks_of_one_thing_merge_and_neighbors_stay_apart(held, frames, seen, expected):
    assert things(lifted(held, frames, seen)) == expected


@pytest.mark.parametrize(("least", "expected"), [(0.5, [0, 1]), (0.1, [0, 0])])
def test_too_small_a_common_part_is_no_evidence(monkeypatch, least, expected):
    seen = [TABLE, [0, 10, 11, 12, 13]]
    monkeypatch.setattr("egosplat.instances.merging.COMMON", least)
    assert things(lifted(seen, [0, 1], seen)) == expected


def test_a_mask_that_contradicts_its_thing_has_no_vote(monkeypatch):
    masks = lifted([TABLE, TABLE, TABLE, [0, *WALL]], [*range(4)], [ALL] * 4)
    monkeypatch.setattr("egosplat.instances.merging.MERGE_IOU", 0.1)
    assert things(masks) == [0, 0, 0, -1]
    monkeypatch.setattr("egosplat.instances.things._DROP_IOU", 0.0)
    assert things(masks) == [0, 0, 0, 0]


def test_an_instance_that_others_hold_already_is_dropped(monkeypatch):
    """Non-maximum suppression in 3D: a mask over a corner of the table, seen once, is no instance beside it."""
    masks = lifted([TABLE, TABLE, TABLE, TABLE[:1]], [0, 1, 2, 3], [ALL] * 4)
    assert things(masks) == [0, 0, 0, -1]
    monkeypatch.setattr("egosplat.instances.things._CLAIMED", 1.0)
    assert things(masks) == [0, 0, 0, 1]


def test_beliefs_are_shares_of_the_weight_in_frames_with_masks():
    """A Gaussian in the masks of all three frames belongs to the thing fully; in those of one, by a third."""
    masks = lifted([TABLE, TABLE[:2], TABLE[:2], WALL], [0, 1, 2, 3], [ALL] * 4)
    found = beliefs(masks, np.array([0, 0, 0, -1])).toarray()[:, 0]
    assert found == pytest.approx([1, 1, 1 / 3, 1 / 3, 0, 0, 0, 0, 0, 0])


def test_what_is_often_missed_is_not_outvoted_by_what_it_lies_on():
    """The table's masks cover half of it in six of ten frames; it has masks in three."""
    masks = lifted([TABLE] * 6 + [TABLE[2:]] * 4 + [TABLE[:2]] * 3, [*range(10), 7, 8, 9], [ALL] * 10)
    table, lying = beliefs(masks, np.array([0] * 10 + [1] * 3)).toarray().T
    assert (lying[:2] > table[:2]).all() and (table[2:4] == 1).all()


def test_a_single_wrong_mask_does_not_displace_what_many_frames_show():
    masks = lifted([TABLE] * 5 + [TABLE[:2]], [*range(5), 5], [ALL] * 6)
    table, wrong = beliefs(masks, np.array([0] * 5 + [1])).toarray().T
    assert (wrong[:2] == pytest.approx(1 / 3)) and (table[:2] == 1).all()


def make_runs(count: int, gaussians: int, seed: int) -> Runs:
    """Noisy runs of a few things on a line of Gaussians."""
    rng = np.random.default_rng(seed)
    seen = np.where(rng.random((count, gaussians)) < 0.5, 3 * rng.random((count, gaussians)), 0.0)
    votes, centers = np.zeros_like(seen), rng.integers(0, gaussians, max(1, count // 5))
    for run in range(count):
        first = max(0, centers[rng.integers(len(centers))] + rng.integers(-4, 5))
        mine = slice(first, first + rng.integers(15, 30))
        votes[run, mine] = seen[run, mine] * rng.random(seen[run, mine].shape) ** 0.2
    return Runs(sparse.csr_array(votes), sparse.csr_array(seen), rng.random(gaussians))


def agglomerate_slowly(runs: Runs, least: float) -> np.ndarray:
    """Merge the most alike two, comparing all runs that are left with each other every time."""
    into = np.arange(len(runs.held))
    while True:
        iou = np.nan_to_num([runs.overlaps(run, np.arange(len(into))) for run in range(len(into))])
        np.fill_diagonal(iou, 0.0)
        one, other = sorted(np.unravel_index(iou.argmax(), iou.shape))
        if iou[one, other] < least:
            return into
        runs.add(one, other)
        into[into == other] = one


@pytest.mark.parametrize("merge_iou", [0.1, 0.4, 1.0])
@pytest.mark.parametrize("count", [1, 2, 40])
@pytest.mark.parametrize("seed", [0, 1])
def test_merges_are_those_of_comparing_all_runs_anew(monkeypatch, count, merge_iou, seed):
    monkeypatch.setattr("egosplat.instances.merging.MERGE_IOU", merge_iou)
    expected = agglomerate_slowly(make_runs(count, 300, seed), merge_iou)
    found = agglomerate(make_runs(count, 300, seed))
    np.testing.assert_array_equal(found, expected)
    if count == 40 and merge_iou < 1:
        assert 1 < len(np.unique(found)) < count


def test_equal_runs_merge_and_runs_without_a_gaussian_stay_apart():
    votes = sparse.csr_array([[1.0, 1, 0, 0, 0, 0], [0] * 6, [1, 1, 0, 0, 0, 0], [0] * 6])
    runs = Runs(votes, sparse.csr_array(np.ones((4, 6))), np.ones(6))
    assert agglomerate(runs).tolist() == [0, 1, 0, 3]

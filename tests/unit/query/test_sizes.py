"""Sizes of things as evidence for names."""

import numpy as np
import pytest
import torch
from scipy.sparse import csr_array

from egosplat.query.sizes import LIMITS, Sizes, log_ratios, measure_extents, read_sizes, row_of
from egosplat.query.text import CARRIED, STAYING
from egosplat.query.things import find_neighbors

UP = np.array([0.0, 1.0, 0.0])

# Height, long and short side, foot and top of a desk, of a lamp on it and of a couch [m].
DESK, LAMP, COUCH = [0.74, 1.3, 0.65, 0.0, 0.74], [0.45, 0.25, 0.2, 0.75, 1.2], [0.85, 1.95, 0.9, 0.0, 0.85]


def box(center, size, count=400, turn=0.0):
    """Points of a box whose y axis is up, turned about it."""
    points = (np.random.default_rng(0).random((count, 3)) - 0.5) * size
    c, s = np.cos(turn), np.sin(turn)
    return points @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) + center


def told(extents, *phrases):
    """(Q, I) what extents tell of phrases."""
    return log_ratios(np.array(extents))[[*map(row_of, phrases)], :-1]


def test_the_table_has_a_row_for_each_thing_of_a_home_but_what_has_no_size():
    words, rows = read_sizes()
    assert {*CARRIED, *STAYING} - {"hand"} <= {*words} and (np.diff(rows[:, 0]) >= 0).all()
    assert np.isfinite(rows).all() and (rows[:, 1:5] > 0).all() and (rows[:, 2] >= rows[:, 3]).all()


def test_a_phrase_is_looked_up_by_its_last_words():
    for phrase, word in (("red Desk Lamp", "desk lamp"), ("my lamp", "lamp")):
        assert read_sizes()[0][row_of(phrase)] == word
    assert [*map(row_of, ("zebra", "", "couchette"))] == [-1, -1, -1]


def test_sizes_tell_a_desk_from_what_stands_on_it():
    ratios = told([DESK, LAMP, COUCH], "desk", "desk lamp", "couch")
    assert ratios.argmax(axis=1).tolist() == [0, 1, 2] and (np.diag(ratios) > 1).all()


@pytest.mark.parametrize("turn", [0.0, 0.6])
def test_extents_are_those_of_the_largest_part_turned_or_not(turn):
    floor = box([0, 0, 0], [4, 0.001, 4], 4000)
    desk, stray = box([0, 0.5, 0], [1.2, 0.6, 0.5], turn=turn), box([1.8, 0.3, 1.8], [0.1, 0.1, 0.1], 30)
    xyz = np.concatenate([floor, desk, stray])
    instance = np.repeat([-1, 0, 0], [4000, 400, 30])[None].astype(np.int32)
    touching = find_neighbors(xyz, np.full(len(xyz), 0.15))
    extents = measure_extents(xyz, instance, touching, UP)
    np.testing.assert_allclose(extents[0], [0.6, 1.2, 0.5, 0.2, 0.8], atol=0.12)
    few = np.where(np.arange(len(xyz)) < 10, 0, -1)[None].astype(np.int32)
    assert np.isnan(measure_extents(xyz, few, touching, UP)).all()


def test_no_gaussians_have_no_extents():
    none = measure_extents(np.zeros((0, 3)), np.zeros((1, 0), np.int32), csr_array((0, 0)), UP)
    assert none.shape == (0, 5) and not log_ratios(none).any()


def test_relevancies_move_within_limits_and_0_and_1_stay():
    sizes = Sizes(torch.tensor([[0], [1], [-1]]), log_ratios(np.array([DESK, LAMP])))
    relevancy = torch.full((2, 1, 3), 0.5)
    desk, unknown = sizes.weigh(relevancy, ["desk", "unheard of"], 1.0)[:, 0]
    assert desk.logit().tolist() == pytest.approx([LIMITS[1], LIMITS[0], 0.0], abs=1e-5)
    assert torch.equal(unknown, relevancy[1, 0])
    for end in (0.0, 1.0):
        assert (sizes.weigh(torch.full((1, 1, 3), end), ["desk"], 2.0) == end).all()
    assert sizes.weigh(torch.zeros(0, 1, 3), [], 1.0).shape == (0, 1, 3)


@pytest.mark.parametrize("extreme", [0.0, 1e-30, 1e30, 1e300, np.nan])
def test_extents_at_the_extremes_tell_a_finite_number(extreme):
    assert np.isfinite(told(np.full((1, 5), extreme), "desk", "cup", "zebra")).all()

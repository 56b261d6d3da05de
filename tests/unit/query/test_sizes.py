"""Sizes of things as evidence for names."""

import numpy as np
import pytest
import torch
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from egosplat.query.sizes import LIMITS, Sizes, estimate_unit, log_ratios, read_sizes, row_of
from egosplat.query.text import CARRIED, STAYING
from egosplat.query.things import find_neighbors, measure_extents

# Height, long and short side, foot and top of a desk and of a lamp on it [m].
DESK_AND_LAMP = np.array([[0.74, 1.3, 0.65, 0.0, 0.74], [0.45, 0.25, 0.2, 0.75, 1.2]])


def test_the_table_has_a_row_for_each_thing_of_a_home_and_a_phrase_is_looked_up_by_its_last_words():
    words, rows = read_sizes()
    assert {*CARRIED, *STAYING} - {"hand"} <= {*words} and (np.diff(rows[:, 0]) >= 0).all()
    assert np.isfinite(rows).all() and (rows[:, 1:5] > 0).all() and (rows[:, 2] >= rows[:, 3]).all()
    assert words[row_of("red Desk Lamp")] == "desk lamp" and row_of("couchette") == row_of("") == -1


@pytest.mark.parametrize("turn", [0.0, 0.6])
def test_extents_are_those_of_the_largest_part_turned_or_not(turn):
    sizes = [[4, 0.001, 4], [1.2, 0.6, 0.5], [0.1, 0.1, 0.1]]
    centers = [[0, 0, 0], [0, 0.5, 0], [1.8, 0.3, 1.8]]
    part = np.repeat([0, 1, 2], [4000, 400, 30])
    xyz = (np.random.default_rng(0).random((len(part), 3)) - 0.5) * np.take(sizes, part, axis=0)
    xyz = Rotation.from_rotvec([0, turn, 0]).apply(xyz + np.take(centers, part, axis=0))
    measured = find_neighbors(xyz, np.full(len(xyz), 0.15)), np.array([0.0, 1.0, 0.0])
    [extents] = measure_extents(xyz, np.where(part, 0, -1)[None], *measured)
    np.testing.assert_allclose(extents, [0.6, 1.2, 0.5, 0.2, 0.8], atol=0.12)
    assert np.isnan(measure_extents(xyz, np.where(np.arange(len(xyz)) < 10, 0, -1)[None], *measured)).all()
    assert not len(measure_extents(xyz[:0], np.zeros((1, 0), int), csr_array((0, 0)), measured[1]))


def test_relevancies_move_within_limits_and_0_and_1_stay():
    sizes = Sizes(torch.tensor([[0], [1], [-1]]), log_ratios(DESK_AND_LAMP))
    told = sizes.weigh(torch.full((3, 1, 3), 0.5), ["desk", "desk lamp", "unheard of"], 1.0)[:, 0].logit()
    expected = [[LIMITS[1], LIMITS[0], 0], [LIMITS[0], LIMITS[1], 0], [0, 0, 0]]
    np.testing.assert_allclose(told, expected, atol=1e-5)
    assert sizes.weigh(torch.tensor([[[0.0, 1.0, 1.0]]]), ["desk"], 2.0).tolist() == [[[0.0, 1.0, 1.0]]]
    extreme = np.array([0.0, 1e-30, 1e30, 1e300, np.nan])
    assert np.isfinite(log_ratios(np.tile(extreme[:, None], 5))).all()


@pytest.mark.parametrize("unit", [1e-6, 0.3, 1.0, 1e6])
def test_things_of_known_names_tell_the_unit_and_few_or_flat_ones_do_not(unit):
    words, table = read_sizes()
    kind, height, long, short, _, foot, _ = table.T
    extents = np.stack([height, long, short, foot, foot + height], axis=1) / unit
    odds = np.where(np.arange(len(words))[:, None] == kind, 3.0, -3.0)
    told, spread = estimate_unit(extents, words, odds)
    assert told == pytest.approx(unit, rel=0.1) and 0 < spread < 0.1
    extents[12:] = np.nan
    assert estimate_unit(extents, words, odds) and estimate_unit(extents[1:], words, odds[:, 1:]) is None
    assert estimate_unit(0 * extents, words, odds) is None and estimate_unit(extents, (), odds[:0]) is None
    scattered = np.random.default_rng(0).permuted(np.tile(np.geomspace(0.1, 10, 40)[:, None], 5), axis=0)
    assert estimate_unit(scattered, words, np.full((len(words), 40), 2.0)) is None

"""Tracks slip as far, and onto what, is said, and the page has the figures of its rows."""

import numpy as np
import pandas as pd
import pytest

from benchmarks.aggregation.__main__ import METHODS, ROWS, gains
from benchmarks.aggregation.tracks import Tracks, slipped_tracks
from benchmarks.common import ROOT

VIEWS, PAGE = 10, ROOT / "benchmarks/aggregation"


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6])
def test_the_given_share_of_views_shows_one_other_thing_of_the_scene(share):
    thing = np.repeat(np.arange(4), VIEWS)
    feature = np.stack([thing, np.tile(np.arange(VIEWS), 4)], axis=1).astype(np.float32)
    tracks = Tracks(np.array([0, 0, 0, 1]), np.array(["cup", "book", "cup", "book"]), thing, feature)
    found = slipped_tracks(tracks, share, np.random.default_rng(0))
    shown = found[:, 0].reshape(4, VIEWS)
    wrong = shown != np.arange(4)[:, None]
    assert wrong.sum(axis=1).tolist() == [share * VIEWS] * 3 + [0]  # the last is alone in its scene
    assert (shown[[0, 2]][wrong[[0, 2]]] == 1).all() and len({*shown[1][wrong[1]]}) <= 1


def test_all_methods_give_the_mean_of_equal_views_and_some_leave_a_third_out():
    views = np.array([[1.0, 0.0]] * 6 + [[0.0, 1.0]] * 3)
    found = {name: method(views) for name, method in METHODS.items()}
    assert found.pop("mean of all views").tolist() == pytest.approx([2 / 3, 1 / 3])
    assert all(np.allclose(value, [1, 0], atol=0.02) for value in found.values())


def test_the_page_has_the_table_of_its_rows():
    assert gains(pd.read_csv(PAGE / ROWS)) in (PAGE / "README.md").read_text()

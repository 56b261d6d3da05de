"""Tests of the measure of how often intervals hold the truth."""

import numpy as np

from benchmarks.intervals import __main__ as intervals


def test_categories_are_hit_in_all_of_their_frames_or_in_none():
    (scene,) = intervals.draw(np.random.default_rng(0), 1, 50, 0.5, 0.0)
    assert set(scene.totals) == {0.0, intervals.FRAMES} and set(scene.counts) == {intervals.FRAMES}
    assert 0.3 < scene.mean < 0.7


def test_a_row_has_how_often_each_interval_holds_the_truth():
    """Those over categories far more often than those over queries, which are far narrower."""
    cells = [float(cell) for cell in intervals.row(1, 22, 0.55, 0.0, trials=60)]
    assert cells[:4] == [1, 22, 0.55, 0]
    held, width, naive_held, naive_width = cells[4:]
    assert held >= 0.85 > naive_held + 0.05 and width > 1.8 * naive_width

"""Tests of the measure of how often intervals hold the truth."""

import numpy as np

from benchmarks.intervals import __main__ as intervals


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

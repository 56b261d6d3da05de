"""Exposure between aligned images, and its curve over a recording."""

import numpy as np
import pytest

from egosplat.survey.brightness import exposure_curve, exposure_range, gain_stops

SCENE = np.random.default_rng(0).uniform(0.05, 0.3, (40, 40))
"""Linear light."""


def exposed(stops: float) -> np.ndarray:
    return np.clip(255 * (SCENE * 2.0**stops) ** (1 / 2.2), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("stops", [-1.0, 0.0, 0.7])
def test_the_exposure_between_two_images_is_measured_in_stops(stops):
    assert gain_stops(exposed(0), exposed(stops), SCENE > 0) == pytest.approx(stops, abs=0.03)


def test_a_third_of_other_surfaces_does_not_change_the_exposure():
    second = exposed(0.5)
    second[:13] = exposed(3.0)[:13]
    assert gain_stops(exposed(0), second, SCENE > 0) == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("second", [np.zeros((40, 40), np.uint8), np.full((40, 40), 255, np.uint8)])
def test_black_and_saturated_images_have_no_exposure(second):
    assert gain_stops(exposed(0), second, SCENE > 0) is None
    assert gain_stops(exposed(0), exposed(0), SCENE < 0) is None


def test_the_curve_is_summed_along_chains_of_pairs():
    pairs = np.array([[0, 1], [1, 2], [2, 3], [5, 6], [6, 7]])
    curve = exposure_curve(pairs, np.array([0.5, 0.5, np.nan, -0.2, 0.2]))
    assert curve == pytest.approx({0: -0.5, 1: 0.0, 2: 0.5, 5: 0.0, 6: -0.2, 7: 0.0})
    assert exposure_range({0: -0.5, 1: 0.0, 2: 0.5}) == pytest.approx(0.9)


def test_without_pairs_there_is_no_curve():
    assert exposure_curve(np.zeros((0, 2), np.int64), np.zeros(0)) == {} and exposure_range({}) is None

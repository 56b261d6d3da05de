"""Exposure between aligned images, and its curve over a recording."""

import numpy as np
import pytest

from egosplat.survey.brightness import compare_light, equalize, exposure_changes, exposure_curve

SCENE = np.random.default_rng(0).uniform(0.05, 0.3, (40, 40))
"""Linear light."""

ROWS = np.linspace(0.0, 1.0, 40)[:, None] * np.ones((1, 40))


def exposed(stops: float | np.ndarray) -> np.ndarray:
    return np.clip(255 * (SCENE * 2.0**stops) ** (1 / 2.2), 0, 255).astype(np.uint8)


DARK = exposed(0)


def change(second: np.ndarray, first=DARK, mask=SCENE > 0, radii=(ROWS, ROWS)) -> float:
    return float(exposure_changes([compare_light(first, second, mask, radii)])[0])


@pytest.mark.parametrize("stops", [-1.0, 0.0, 0.7])
def test_the_exposure_between_two_images_is_measured_in_stops(stops):
    assert change(exposed(stops)) == pytest.approx(stops, abs=0.03)


def test_a_third_of_other_surfaces_does_not_change_the_exposure():
    second = exposed(0.5)
    second[:13] = exposed(3.0)[:13]
    assert change(second) == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("second", [np.zeros((40, 40), np.uint8), np.full((40, 40), 255, np.uint8)])
def test_black_and_saturated_images_have_no_exposure(second):
    assert np.isnan(change(second)) and np.isnan(change(exposed(0), mask=SCENE < 0))
    assert exposure_changes([]).shape == (0,)


def test_vignetting_is_not_exposure():
    """Surfaces move outwards, where the image is darker."""
    radii = 0.8 * ROWS, 0.8 * ROWS + 0.2
    first, second = (exposed(-1.5 * radius**2) for radius in radii)
    assert change(second, first) < -0.2
    assert change(second, first, radii=radii) == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("gain, offset", [(0.5, 20), (1.4, -30), (0.0, 0), (0.0, 255)])
def test_brightness_is_equalized(gain, offset):
    first = exposed(0)
    second = np.clip(gain * first + offset, 0, 255).astype(np.uint8)
    found = equalize(second, first.ravel(), second.ravel())
    assert found.dtype == np.uint8 and np.isfinite(found).all()
    if gain:
        assert np.abs(found.astype(float) - first).mean() < 3
    assert (equalize(second, first[:0, 0], second[:0, 0]) == second).all()


def test_the_curve_is_summed_along_chains_of_pairs():
    pairs = np.array([[0, 1], [1, 2], [2, 3], [5, 6], [6, 7]])
    curve = exposure_curve(pairs, np.array([0.5, -0.5, np.nan, -0.2, 0.2]))
    assert curve == pytest.approx({0: 0.0, 1: 0.5, 2: 0.0, 5: 0.0, 6: -0.2, 7: 0.0})


def test_a_bias_does_not_add_up():
    pairs = np.stack([np.arange(119), np.arange(1, 120)], axis=1)
    assert list(exposure_curve(pairs, np.full(119, 0.005)).values()) == pytest.approx([0.0] * 120, abs=1e-9)
    assert np.ptp(list(exposure_curve(pairs, np.full(119, 0.02)).values())) > 1.0
    assert exposure_curve(pairs[:0], np.zeros(0)) == {}

"""Noise, residual vignetting, auto-exposure and white balance against their definitions."""

import numpy as np
import pytest

from egosplat_apartments.camera.effects import Effects
from egosplat_apartments.camera.exposure import (
    LONGEST_S,
    WHITE,
    add_noise,
    auto_exposure,
    expose,
    falloff,
    white_balance,
)
from egosplat_apartments.camera.lens import tone


def noise_of(share, effects, gain=1.0):
    light = np.full((200_000, 3), share * WHITE, np.float32)
    values = add_noise(light, effects, gain, np.random.default_rng(3)).astype(np.float64) / WHITE
    return values.mean(), values.var()


def test_the_variance_of_shot_noise_grows_linearly_with_the_light():
    shares = np.array([0.1, 0.2, 0.4, 0.8])
    found = [noise_of(share, Effects(shot_noise=0.02)) for share in shares]
    assert [mean for mean, _ in found] == pytest.approx(shares, rel=1e-3)
    assert [variance for _, variance in found] == pytest.approx(0.02**2 * shares, rel=0.02)


def test_read_noise_does_not_depend_on_the_light():
    for share in (0.2, 0.7):
        assert noise_of(share, Effects(read_noise=0.01))[1] == pytest.approx(0.01**2, rel=0.02)
    both = noise_of(0.5, Effects(shot_noise=0.02, read_noise=0.01))[1]
    assert both == pytest.approx(0.02**2 * 0.5 + 0.01**2, rel=0.02)


def test_amplified_light_has_fewer_photons():
    quiet, loud = (noise_of(0.5, Effects(shot_noise=0.01), gain)[1] for gain in (1.0, 4.0))
    assert loud == pytest.approx(4 * quiet, rel=0.03)
    quiet, loud = (noise_of(0.5, Effects(read_noise=0.005), gain)[1] for gain in (1.0, 4.0))
    assert loud == pytest.approx(16 * quiet, rel=0.03)


def test_white_is_what_saturates_the_display():
    assert tone(np.array([WHITE], np.float32))[0] == pytest.approx(1, abs=1e-4)


def test_vignetting_takes_the_asked_light_at_the_edge():
    radius = np.array([0.0, 0.5, 1.0], np.float32)
    assert falloff(radius, Effects(vignetting=0.2)) == pytest.approx([1, 0.95, 0.8])
    assert (falloff(radius, Effects(vignetting=4.0)) >= 0).all()


SECONDS = np.arange(40) * 0.2


def test_auto_exposure_covers_the_asked_range_and_darkens_bright_views():
    brightness = np.where(np.arange(40) < 20, 0.1, 0.4)
    factors = auto_exposure(brightness, SECONDS, 1.5)
    assert np.log2(factors.max() / factors.min()) == pytest.approx(1.5)
    assert factors[0] > factors[-1] and (np.diff(factors) <= 1e-12).all()
    assert factors.max() * factors.min() == pytest.approx(1)


def test_auto_exposure_lags():
    factors = auto_exposure(np.where(np.arange(400) < 10, 0.1, 0.2), np.arange(400) * 0.01, 1.0)
    way = (np.log2(factors[0]) - np.log2(factors)) / np.log2(factors[0] / factors[-1])
    assert way[9] == pytest.approx(0) and way[9 + 30] == pytest.approx(1 - np.exp(-1), abs=0.01)


def test_constant_brightness_keeps_the_exposure():
    assert (auto_exposure(np.full(40, 0.3), SECONDS, 4.0) == 1).all()
    flicker = 0.3 * (1 + 1e-4 * np.sin(np.arange(40)))
    assert auto_exposure(flicker, SECONDS, 4.0) == pytest.approx(1, abs=2e-3)


def test_long_exposures_become_gain():
    assert expose(1.2, 0.009) == pytest.approx((0.0108, 1.0))
    seconds, gain = expose(4.0, 0.009)
    assert seconds == LONGEST_S and seconds * gain == pytest.approx(0.036)
    assert expose(2.0, 0.0) == (0.0, 2.0)


def test_white_balance_has_the_asked_deviation():
    channels = white_balance(Effects(white_balance=0.03), 5, np.arange(0, 3000, 1.0))
    assert (channels[:, 1] == 1).all()
    assert channels[:, [0, 2]].std(axis=0) == pytest.approx([0.03, 0.03], rel=0.15)
    assert np.abs(np.diff(channels, axis=0)).max() < 0.03
    assert (white_balance(Effects(), 5, np.arange(3.0)) == 1).all()

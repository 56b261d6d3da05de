"""Light on a sensor: no light and too much of it, no gain and a million, exposures of no time."""

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
from egosplat_apartments.camera.lens import develop

NOISY = Effects(shot_noise=0.01, read_noise=0.001)


@pytest.mark.numerics(
    "sensor: light of 0 to 1e30 and gains of 0 to 1e6, without noise",
    within=1e-6,
    outside="more light than white is white",
)
def test_light_without_noise(measured):
    light = np.outer(np.concatenate([[0], 10.0 ** np.arange(-30, 31)]), np.ones(3)).astype(np.float32)
    for gain in (0.0, 1e-6, 1.0, 1e6):
        found = add_noise(light, Effects(), gain, np.random.default_rng(0))
        measured(np.abs(found - np.minimum(light.astype(np.float64), WHITE)).max())


@pytest.mark.numerics(
    "sensor: shot and read noise of 16 times white, gains of 0 to 1e6",
    outside="finite, between black and white",
)
@pytest.mark.parametrize("gain", [0.0, 1.0, 1e6])
@pytest.mark.parametrize("share", [0.0, 1.0])
def test_loud_noise(gain, share):
    light = np.full((1000, 3), share * WHITE, np.float32)
    found = add_noise(light, Effects(shot_noise=16.0, read_noise=16.0), gain, np.random.default_rng(0))
    assert np.isfinite(found).all() and found.min() >= 0 and found.max() <= np.float32(WHITE)


@pytest.mark.numerics(
    "a black frame and a lit one at gains of 0 and 1e6",
    outside="black stays black; light is white",
)
def test_frames_at_a_gain_of_a_million():
    def frame(radiance, gain, effects=NOISY):
        values, radius = np.full((5000, 3), radiance, np.float32), np.zeros(5000, np.float32)
        dither, noise = map(np.random.default_rng, range(2))
        return develop(values, radius, gain, dither, lambda light: add_noise(light, effects, 1.0, noise))

    assert frame(0.0, 1e6).mean() < 8 and frame(0.3, 0.0).mean() < 8
    assert (frame(1e-3, 1e6, Effects()) >= 240).all() and frame(1e30, 1e6).min() > 240


@pytest.mark.numerics(
    "auto-exposure: views of 0, 1e-30 and 1e30, one frame, one time, 16 times 20 stops",
    outside="factors stay within 2^-20 and 2^20",
)
def test_auto_exposure():
    brightness = np.array([0.0, 0.2, 1e-30, 1e30, 0.0])
    for seconds in (np.arange(5.0), np.zeros(5), np.arange(5) * 1e6):
        for stops in (0.0, 1.0, 320.0):
            factors = auto_exposure(brightness, seconds, stops)
            assert np.isfinite(factors).all() and (np.abs(np.log2(factors)) <= 20).all()
    assert auto_exposure(np.zeros(1), np.zeros(1), 4.0).tolist() == [1.0]
    assert auto_exposure(np.zeros(9), np.arange(9.0), 4.0).tolist() == [1.0] * 9


@pytest.mark.numerics(
    "time times gain: exposures of 0 to 0.8 s, factors of 1e-6 to 1e6",
    within=1e-15,
)
def test_exposure_times(measured):
    for nominal in (1e-9, 1e-5, 0.009, 0.8):
        for factor in (1e-6, 1.0, 1e6):
            seconds, gain = expose(factor, nominal)
            assert 0 < seconds <= max(LONGEST_S, nominal)
            measured(abs(seconds * gain / (factor * nominal) - 1))
    assert expose(1e6, 0.0) == (0.0, 1e6)


@pytest.mark.numerics(
    "vignetting and white balance of 16 times everything, one frame", outside="no factor below 0"
)
def test_factors():
    effects = Effects(vignetting=16.0, white_balance=16.0)
    edge = falloff(np.linspace(0, 1, 11, dtype=np.float32), effects)
    assert edge[0] == 1 and edge[-1] == 0 and (edge >= 0).all()
    for seconds in (np.zeros(1), np.arange(500.0)):
        channels = white_balance(effects, 3, seconds)
        assert np.isfinite(channels).all() and (channels >= 0).all() and (channels[:, 1] == 1).all()

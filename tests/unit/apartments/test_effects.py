"""Effects of a real camera against their definitions: drift, noise, vignetting, exposure and white balance."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egosplat.geometry import compose, invert, is_rigid, make_pose
from egosplat_apartments.camera.drift import Drift, SmoothNoise, estimated_trajectory
from egosplat_apartments.camera.effects import Effects
from egosplat_apartments.camera.exposure import WHITE, add_noise, auto_exposure, falloff, white_balance

START_NS, END_NS = 80_000_000_000_000, 83_000_000_000_000
TIMES = np.arange(START_NS, END_NS, 100_000_000)


def device_pose(times_ns):
    seconds = (np.asarray(times_ns, dtype=np.int64) - START_NS)[:, None] * 1e-9
    return make_pose(Rotation.from_rotvec(seconds * [0, 0.2, 0]).as_matrix(), seconds * [0.5, 0, 0])


def estimated(effects, seed=1, times=TIMES):
    drift = Drift(effects, seed, START_NS, END_NS)
    return estimated_trajectory(device_pose, effects, drift, START_NS, END_NS)(times)


def rms(values):
    return np.sqrt((values**2).sum(axis=-1).mean())


def test_drift_has_the_asked_size_and_is_slow():
    found = estimated(Effects(drift_m=0.02, drift_rad=0.005))
    assert is_rigid(found).all()
    error = compose(invert(device_pose(TIMES)), found)
    assert rms(found[:, :3, 3] - device_pose(TIMES)[:, :3, 3]) == pytest.approx(0.02, rel=0.1)
    assert rms(Rotation.from_matrix(error[:, :3, :3]).as_rotvec()) == pytest.approx(0.005, rel=0.1)
    shift = estimated(Effects(drift_m=0.02, drift_s=5.0))[:, :3, 3] - device_pose(TIMES)[:, :3, 3]
    # A correlation of exp(-t²/2T²) gives differences of RMS sqrt(2 - 2 exp(-t²/2T²)).
    for step in (1, 10, 50):
        expected = 0.02 * np.sqrt(2 - 2 * np.exp(-((step * 0.1 / 5.0) ** 2) / 2))
        assert rms(shift[step:] - shift[:-step]) == pytest.approx(expected, rel=0.12)


def test_smooth_noise_has_unit_variance_everywhere():
    noise = SmoothNoise(np.random.default_rng(0), 20_000, 2.0, 0.0, 4.0)
    assert noise(np.linspace(0, 4, 9)).std(axis=1) == pytest.approx(np.ones(9), rel=0.03)
    assert noise(np.array([-5.0, 9.0])) == pytest.approx(noise(np.array([0.0, 4.0])))


def test_drift_depends_on_the_seed_alone():
    effects = Effects(drift_m=0.02)
    assert np.array_equal(estimated(effects), estimated(effects))
    assert not np.allclose(estimated(effects), estimated(effects, seed=2), atol=1e-3)
    turned = estimated(Effects(drift_m=0.02, drift_rad=0.1))
    assert np.array_equal(turned[:, :3, 3], estimated(effects)[:, :3, 3])


def test_vignetting_takes_the_asked_light_at_the_edge():
    radius = np.array([0.0, 0.5, 1.0], np.float32)
    assert falloff(radius, Effects(vignetting=0.2)) == pytest.approx([1, 0.95, 0.8])
    assert (falloff(radius, Effects(vignetting=4.0)) >= 0).all()


@pytest.mark.parametrize(
    "shot, read, gain, share",
    [(0.02, 0.0, 4.0, 0.2), (0.0, 0.01, 4.0, 0.7), (0.02, 0.01, 1.0, 0.7), (0.02, 0.01, 4.0, 0.2)],
)
def test_variances_of_the_noise_add(shot, read, gain, share):
    light = np.full((200_000, 3), share * WHITE, np.float32)
    effects = Effects(shot_noise=shot, read_noise=read)
    found = add_noise(light, effects, gain, np.random.default_rng(3)).astype(np.float64) / WHITE
    assert found.mean() == pytest.approx(share, rel=1e-3)
    assert found.var() == pytest.approx(shot**2 * gain * share + (read * gain) ** 2, rel=0.03)


SECONDS = np.arange(40) * 0.2


def test_auto_exposure_covers_the_asked_range_darkens_bright_views_and_lags():
    factors = auto_exposure(np.where(np.arange(40) < 20, 0.1, 0.4), SECONDS, 1.5)
    assert np.log2(factors.max() / factors.min()) == pytest.approx(1.5)
    assert factors[0] > factors[-1] and (np.diff(factors) <= 1e-12).all()
    assert factors.max() * factors.min() == pytest.approx(1)
    factors = auto_exposure(np.where(np.arange(400) < 10, 0.1, 0.2), np.arange(400) * 0.01, 1.0)
    way = (np.log2(factors[0]) - np.log2(factors)) / np.log2(factors[0] / factors[-1])
    assert way[9] == pytest.approx(0) and way[9 + 30] == pytest.approx(1 - np.exp(-1), abs=0.01)
    assert (auto_exposure(np.full(40, 0.3), SECONDS, 4.0) == 1).all()
    flicker = 0.3 * (1 + 1e-4 * np.sin(np.arange(40)))
    assert auto_exposure(flicker, SECONDS, 4.0) == pytest.approx(1, abs=2e-3)


def test_white_balance_has_the_asked_deviation():
    channels = white_balance(Effects(white_balance=0.03), 5, np.arange(0, 3000, 1.0))
    assert (channels[:, 1] == 1).all()
    assert channels[:, [0, 2]].std(axis=0) == pytest.approx([0.03, 0.03], rel=0.15)
    assert np.abs(np.diff(channels, axis=0)).max() < 0.03
    assert (white_balance(Effects(), 5, np.arange(3.0)) == 1).all()

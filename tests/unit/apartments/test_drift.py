"""The error of the closed-loop trajectory: its size, its speed and its clock."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egosplat.geometry import compose, invert, is_rigid, make_pose
from egosplat_apartments.camera.drift import Drift, SmoothNoise, estimated_trajectory
from egosplat_apartments.camera.effects import Effects

START_NS, END_NS = 80_000_000_000_000, 83_000_000_000_000
TIMES = np.arange(START_NS, END_NS, 100_000_000)


def device_pose(times_ns):
    seconds = (np.asarray(times_ns, dtype=np.int64) - START_NS)[:, None] * 1e-9
    return make_pose(Rotation.from_rotvec(seconds * [0, 0.2, 0]).as_matrix(), seconds * [0.5, 0, 0])


def estimated(effects, seed=1, times=TIMES):
    drift = Drift(effects, seed, START_NS, END_NS)
    return estimated_trajectory(device_pose, effects, drift, START_NS, END_NS)(times)


def test_drift_has_the_asked_size():
    found = estimated(Effects(drift_m=0.02, drift_rad=0.005))
    assert is_rigid(found).all()
    error = compose(invert(device_pose(TIMES)), found)
    shift = found[:, :3, 3] - device_pose(TIMES)[:, :3, 3]
    turn = Rotation.from_matrix(error[:, :3, :3]).magnitude()
    assert np.sqrt((shift**2).sum(axis=1).mean()) == pytest.approx(0.02, rel=0.1)
    assert np.sqrt((turn**2).mean()) == pytest.approx(0.005, rel=0.1)


def test_drift_is_slow():
    shift = estimated(Effects(drift_m=0.02, drift_s=5.0))[:, :3, 3] - device_pose(TIMES)[:, :3, 3]

    def change(step):
        return np.sqrt(((shift[step:] - shift[:-step]) ** 2).sum(axis=1).mean())

    # A correlation of exp(-t²/2T²) gives differences of RMS sqrt(2 - 2 exp(-t²/2T²)).
    for step in (1, 10, 50):
        expected = 0.02 * np.sqrt(2 - 2 * np.exp(-((step * 0.1 / 5.0) ** 2) / 2))
        assert change(step) == pytest.approx(expected, rel=0.12)


def test_smooth_noise_has_unit_variance_everywhere():
    noise = SmoothNoise(np.random.default_rng(0), 20_000, 2.0, 0.0, 4.0)
    assert noise(np.linspace(0, 4, 9)).std(axis=1) == pytest.approx(np.ones(9), rel=0.03)
    assert noise(np.array([-5.0, 9.0])) == pytest.approx(noise(np.array([0.0, 4.0])))


def test_a_time_offset_shifts_the_clock():
    times = TIMES[10:20]
    found = estimated(Effects(time_offset_ns=2_500_000), times=times)
    assert np.array_equal(found, device_pose(times + 2_500_000))
    assert np.linalg.norm(found[0, :3, 3] - device_pose(times)[0, :3, 3]) == pytest.approx(0.5 * 0.0025)


def test_drift_depends_on_the_seed_alone():
    effects = Effects(drift_m=0.02)
    assert np.array_equal(estimated(effects), estimated(effects))
    assert not np.allclose(estimated(effects), estimated(effects, seed=2), atol=1e-3)
    turned = estimated(Effects(drift_m=0.02, drift_rad=0.1))
    assert np.array_equal(turned[:, :3, 3], estimated(effects)[:, :3, 3])

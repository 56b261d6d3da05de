"""Cameras of recordings at their extremes: light and gain, clocks off by more than the recording, drift of meters."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egosplat.geometry import is_rigid, make_pose
from egosplat.pipeline.config import defaults, section_keys
from egosplat_apartments.camera import exposure
from egosplat_apartments.camera.drift import Drift, SmoothNoise, estimated_trajectory
from egosplat_apartments.camera.effects import IDEAL, KEYS, Effects, make_effects
from egosplat_apartments.camera.exposure import LONGEST_S, WHITE, add_noise, auto_exposure, expose
from egosplat_apartments.camera.lens import develop, make_lens
from egosplat_apartments.stage import SyntheticOptions, make_renderer, record_world
from egosplat_apartments.world.world import make_world

NOISY = Effects(shot_noise=0.01, read_noise=0.001)
START_NS, END_NS = 80_000_000_000_000, 80_004_000_000_000


def device_pose(times_ns):
    """A walk that is known only from start to end."""
    times_ns = np.asarray(times_ns, dtype=np.int64)
    assert times_ns.min() >= START_NS and times_ns.max() <= END_NS
    seconds = (times_ns - START_NS)[:, None] * 1e-9
    return make_pose(Rotation.from_rotvec(seconds * [0, 1.0, 0]).as_matrix(), seconds * [1.0, 0, 0])


def closed_loop(effects, times_ns):
    drift = Drift(effects, 1, START_NS, END_NS)
    return estimated_trajectory(device_pose, effects, drift, START_NS, END_NS)(np.asarray(times_ns))


@pytest.mark.numerics(
    "trajectory's clock off by 1 ns to 160 s, recording of 4 s",
    within=0.0,
    outside="device stands still beyond it",
)
def test_time_offsets(measured):
    times = np.linspace(START_NS, END_NS, 9).astype(np.int64)
    for offset in (-160_000_000_000, -4_000_000_000, -1, 1, 2_500_000, 160_000_000_000):
        found = closed_loop(Effects(time_offset_ns=offset), times)
        measured(np.abs(found - device_pose(np.clip(times + offset, START_NS, END_NS))).max())
        if abs(offset) >= END_NS - START_NS:
            assert (found == found[0]).all()


@pytest.mark.numerics("drift of 1e-9 to 16 m, up to 1440°, within 0.1 s to 1e6 s", outside="poses stay rigid")
@pytest.mark.parametrize("drift_s", [0.1, 5.0, 1e6])
@pytest.mark.parametrize(("meters", "degrees"), [(1e-9, 1e-9), (0.01, 180.0), (16.0, 1440.0)])
def test_drift(drift_s, meters, degrees):
    effects = Effects(drift_m=meters, drift_rad=np.deg2rad(degrees), drift_s=drift_s)
    found = closed_loop(effects, np.linspace(START_NS, END_NS, 100).astype(np.int64))
    assert is_rigid(found).all()
    assert np.abs(found[:, :3, 3]).max() < 4 + 10 * meters


@pytest.mark.numerics("smooth noise over 0 s, 1 hour, beyond", outside="keeps the values at its ends")
def test_spans():
    for span in (0.0, 1e-9, 3600.0):
        noise = SmoothNoise(np.random.default_rng(0), 2, 5.0, 0.0, span)
        values = noise(np.array([-1e9, 0.0, span / 2, span, 1e9]))
        assert np.isfinite(values).all() and np.abs(values).max() < 10
        assert np.array_equal(values[0], values[1]) and np.array_equal(values[-1], values[-2])


@pytest.mark.numerics(
    "one or two frames, effects 16 times a real camera's, drift and exposure 16 times their maxima",
    outside="labels and depth of the ideal camera",
)
def test_extreme_cameras():
    keys = section_keys("synthetic")
    world = make_world(seed=8, seconds=2.0, objects=16, motion=0.5)
    renderer = make_renderer(world, make_lens(64))
    for seconds, values in ((2.0, {}), (1.0, {key: keys[key]["anyOf"][0]["maximum"] for key in KEYS})):
        extreme = {"camera": "real", "camera_strength": 16.0, "drift_s": 0.1} | values
        effects = make_effects(SyntheticOptions(**defaults()["synthetic"] | extreme))
        about = {"name": "x", "fps": 1.0, "seconds": seconds}
        hard, ideal = (record_world(world, renderer, effects=one, **about) for one in (effects, IDEAL))
        times = np.linspace(hard.start_ns, hard.end_ns, 50).astype(np.int64)
        assert is_rigid(hard.estimated_pose(times)).all() and np.isfinite(hard.points).all()
        for one, other in zip(hard.frames(), ideal.frames(), strict=True):
            assert one.rgb.dtype == np.uint8 and np.isfinite([one.exposure_s, one.gain]).all()
            assert np.array_equal(one.with_people.segmentation, other.with_people.segmentation)
            assert np.array_equal(one.with_people.depth_mm, other.with_people.depth_mm)


@pytest.mark.numerics(
    "sensor without noise: light of 0 to 1e30, gain of 0 to 1e6",
    within=1e-6,
    outside="more light than white: white",
)
def test_light_without_noise(measured):
    light = np.outer(np.concatenate([[0], 10.0 ** np.arange(-30, 31)]), np.ones(3)).astype(np.float32)
    for gain in (0.0, 1e-6, 1.0, 1e6):
        found = add_noise(light, Effects(), gain, np.random.default_rng(0))
        measured(np.abs(found - np.minimum(light.astype(np.float64), WHITE)).max())


@pytest.mark.numerics(
    "sensor: shot and read noise 16 times white, gain of 0 to 1e6", outside="between black and white"
)
@pytest.mark.parametrize("gain", [0.0, 1.0, 1e6])
@pytest.mark.parametrize("share", [0.0, 1.0])
def test_loud_noise(gain, share):
    light = np.full((1000, 3), share * WHITE, np.float32)
    found = add_noise(light, Effects(shot_noise=16.0, read_noise=16.0), gain, np.random.default_rng(0))
    assert np.isfinite(found).all() and found.min() >= 0 and found.max() <= np.float32(WHITE)


@pytest.mark.numerics("black frame and lit frame, gain 0 and 1e6", outside="black; white")
def test_frames_at_a_gain_of_a_million():
    def frame(radiance, gain, effects=NOISY):
        values, radius = np.full((5000, 3), radiance, np.float32), np.zeros(5000, np.float32)
        dither, noise = map(np.random.default_rng, range(2))
        return develop(values, radius, gain, dither, lambda light: add_noise(light, effects, 1.0, noise))

    assert frame(0.0, 1e6).mean() < 8 and frame(0.3, 0.0).mean() < 8
    assert (frame(1e-3, 1e6, Effects()) >= 240).all() and frame(1e30, 1e6).min() > 240


@pytest.mark.numerics(
    "auto-exposure: views 0, 1e-30, 1e30; one frame; one time; 16 times 20 stops",
    outside="factors within 2^-20 and 2^20",
)
def test_auto_exposure():
    brightness = np.array([0.0, 0.2, 1e-30, 1e30, 0.0])
    for seconds in (np.arange(5.0), np.zeros(5), np.arange(5) * 1e6):
        for stops in (0.0, 1.0, 320.0):
            factors = auto_exposure(brightness, seconds, stops)
            assert np.isfinite(factors).all() and (np.abs(np.log2(factors)) <= 20).all()
    assert auto_exposure(np.zeros(1), np.zeros(1), 4.0).tolist() == [1.0]
    assert auto_exposure(np.zeros(9), np.arange(9.0), 4.0).tolist() == [1.0] * 9


@pytest.mark.numerics("exposure time times gain: 0 to 0.8 s, factors of 1e-6 to 1e6", within=1e-15)
def test_exposure_times(measured):
    for nominal in (1e-9, 1e-5, 0.009, 0.8):
        for factor in (1e-6, 1.0, 1e6):
            seconds, gain = expose(factor, nominal)
            assert 0 < seconds <= max(LONGEST_S, nominal)
            measured(abs(seconds * gain / (factor * nominal) - 1))
    assert expose(1e6, 0.0) == (0.0, 1e6)


@pytest.mark.numerics(
    "vignetting and white balance 16 times a real camera's, one frame", outside="no factor below 0"
)
def test_factors():
    effects = Effects(vignetting=16.0, white_balance=16.0)
    edge = exposure.falloff(np.linspace(0, 1, 11, dtype=np.float32), effects)
    assert edge[0] == 1 and edge[-1] == 0 and (edge >= 0).all()
    for seconds in (np.zeros(1), np.arange(500.0)):
        channels = exposure.white_balance(effects, 3, seconds)
        assert np.isfinite(channels).all() and (channels >= 0).all() and (channels[:, 1] == 1).all()

"""Recordings of extreme cameras: clocks that are off by more than the recording, drift of meters, one frame."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from egosplat.geometry import is_rigid, make_pose
from egosplat.pipeline.config import defaults, section_keys
from egosplat_apartments.camera.drift import Drift, SmoothNoise, estimated_trajectory
from egosplat_apartments.camera.effects import IDEAL, REAL, Effects, make_effects
from egosplat_apartments.camera.lens import make_lens
from egosplat_apartments.stage import SyntheticOptions, make_renderer, record_world
from egosplat_apartments.world.world import make_world

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
    "trajectories whose clock is off by 1 ns to 160 s, in a recording of 4 s",
    within=0.0,
    outside="the device stands still beyond it",
)
def test_time_offsets(measured):
    times = np.linspace(START_NS, END_NS, 9).astype(np.int64)
    for offset in (-160_000_000_000, -4_000_000_000, -1, 1, 2_500_000, 160_000_000_000):
        found = closed_loop(Effects(time_offset_ns=offset), times)
        measured(np.abs(found - device_pose(np.clip(times + offset, START_NS, END_NS))).max())
        if abs(offset) >= END_NS - START_NS:
            assert (found == found[0]).all()


@pytest.mark.numerics(
    "drift of 1e-9 to 16 m and up to 1440° within 0.1 s to 1e6 s", outside="poses stay rigid"
)
@pytest.mark.parametrize("drift_s", [0.1, 5.0, 1e6])
@pytest.mark.parametrize(("meters", "degrees"), [(1e-9, 1e-9), (0.01, 180.0), (16.0, 1440.0)])
def test_drift(drift_s, meters, degrees):
    effects = Effects(drift_m=meters, drift_rad=np.deg2rad(degrees), drift_s=drift_s)
    found = closed_loop(effects, np.linspace(START_NS, END_NS, 100).astype(np.int64))
    assert is_rigid(found).all()
    assert np.abs(found[:, :3, 3]).max() < 4 + 10 * meters


@pytest.mark.numerics("smooth noise over 0 s, 1 hour, and beyond", outside="it keeps the values at its ends")
def test_spans():
    for span in (0.0, 1e-9, 3600.0):
        noise = SmoothNoise(np.random.default_rng(0), 2, 5.0, 0.0, span)
        values = noise(np.array([-1e9, 0.0, span / 2, span, 1e9]))
        assert np.isfinite(values).all() and np.abs(values).max() < 10
        assert np.array_equal(values[0], values[1]) and np.array_equal(values[-1], values[-2])


@pytest.mark.numerics(
    "one frame and two: effects 16 times a real camera's, and 16 times their maxima",
    outside="labels and depth as the ideal camera's",
)
def test_extreme_cameras():
    keys = section_keys("synthetic")
    world = make_world(seed=8, seconds=2.0, objects=16, motion=0.5)
    renderer = make_renderer(world, make_lens(64))
    for seconds, values in ((2.0, {}), (1.0, {key: keys[key]["anyOf"][0]["maximum"] for key in REAL})):
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

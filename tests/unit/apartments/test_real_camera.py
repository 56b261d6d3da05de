"""A recording of a real camera: which effects the keys give, what each changes, and what stays true."""

import functools
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from egosplat.pipeline.config import defaults
from egosplat.pipeline.options import keys_of
from egosplat_apartments import stage
from egosplat_apartments.adt_format.adt import write_sequence
from egosplat_apartments.camera.effects import IDEAL, KEYS, REAL, Effects, make_effects
from egosplat_apartments.camera.lens import make_lens
from egosplat_apartments.stage import SyntheticOptions, make_renderer, record_world, run
from tests.unit.apartments.conftest import SMALL_WORLD, digest_of

TINY = SMALL_WORLD | {"size": 64, "fps": 2.0}


def effects_of(**changes):
    keys = defaults()["synthetic"] | changes
    return make_effects(SyntheticOptions(**keys))


@pytest.fixture(scope="module")
def film(small_world):
    renderer = make_renderer(small_world, make_lens(64))

    @functools.cache
    def make(effects=IDEAL):
        sequence = record_world(small_world, renderer, name="tiny", fps=2.0, seconds=3.0, effects=effects)
        return sequence, list(sequence.frames())

    return make


@pytest.fixture(scope="module")
def ideal(film):
    return film()


def test_the_ideal_camera_records_what_it_always_did(ideal):
    sequence, frames = ideal
    digest = digest_of(sequence, frames)
    times = np.linspace(sequence.start_ns, sequence.end_ns, 50).astype(np.int64)
    digest.update((sequence.device_pose(times).round(9) + 0.0).tobytes())
    digest.update(" ".join(f"{frame.exposure_s} {frame.gain:.9f}" for frame in frames).encode())
    assert sequence.estimated_pose is None
    assert digest.hexdigest() == "f60fb6d8e5f713eb6ce96ce2ff020d96be9628e707cc5719f647949f68c53d9b"


def test_defaults_are_an_ideal_camera_and_a_real_one_has_every_effect():
    assert effects_of() == IDEAL
    values = {key: value for group in REAL.values() for key, value in group.items()}
    for key, (name, unit) in KEYS.items():
        assert f"auto is {values[name] / unit:g} where" in keys_of(SyntheticOptions)[key]["description"], key
    effects = effects_of(camera="real")
    differs = {name for name, value in vars(effects).items() if value != getattr(IDEAL, name)}
    assert differs == set(vars(effects)) - {"drift_s"}
    assert effects.exposure_s == pytest.approx(0.009) and effects.time_offset_ns == 2_500_000
    assert effects_of(camera="shutter") == Effects(exposure_s=effects.exposure_s, readout_s=effects.readout_s)


def test_strength_is_a_factor_on_all_effects():
    once, twice = (effects_of(camera="real", camera_strength=k) for k in (1, 2))
    for name in vars(once):
        if name != "drift_s":
            assert getattr(twice, name) == pytest.approx(2 * getattr(once, name)), name
    assert (once.jpeg_quality, twice.jpeg_quality) == (90, 85)
    assert effects_of(camera="real", camera_strength=0) == IDEAL
    assert effects_of(drift_mm=3, camera_strength=2) == Effects(drift_m=0.006)
    assert effects_of(camera="sensor", camera_strength=16).jpeg_quality == 15


@pytest.mark.parametrize(
    "effect", [{"drift_m": 0.02}, {"drift_rad": 0.004}, {"time_offset_ns": 2_500_000}, {"jpeg_loss": 45}]
)
def test_errors_of_the_trajectory_change_no_frame(film, ideal, effect):
    effects = Effects(**effect)
    sequence, frames = film(effects)
    assert all(np.array_equal(a.rgb, b.rgb) for a, b in zip(ideal[1], frames, strict=True))
    times = np.linspace(sequence.start_ns, sequence.end_ns, 20).astype(np.int64)
    assert np.array_equal(sequence.device_pose(times), ideal[0].device_pose(times))
    assert np.array_equal(sequence.points, ideal[0].points) != effects.drifts
    assert (sequence.estimated_pose is None) == (effects.jpeg_quality == 50)
    if sequence.estimated_pose:
        assert np.abs(sequence.estimated_pose(times) - sequence.device_pose(times)).max() > 1e-5


ON_LIGHT = {"exposure_s": 0.02, "readout_s": 0.01, "exposure_stops": 1.0, "white_balance": 0.05}
ON_LIGHT |= {"shot_noise": 0.02, "read_noise": 0.01, "vignetting": 0.2}


@pytest.mark.parametrize("name", ON_LIGHT)
def test_effects_on_light_change_frames_alone(film, ideal, name):
    sequence, frames = film(Effects(**{name: ON_LIGHT[name]}))
    assert sequence.estimated_pose is None and np.array_equal(sequence.points, ideal[0].points)
    for one, other in zip(ideal[1], frames, strict=True):
        assert np.array_equal(one.with_people.segmentation, other.with_people.segmentation)
        assert np.array_equal(one.without_people.depth_mm, other.without_people.depth_mm)
        assert one.with_people.visibility == other.with_people.visibility
    pairs = zip(ideal[1], frames, strict=True)
    assert 0.05 < np.mean([np.abs(a.rgb.astype(int) - b.rgb).mean() for a, b in pairs]) < 30


def test_the_ground_truth_is_exact_and_the_closed_loop_errs(ideal, small_world, tmp_path, monkeypatch):
    asked = SMALL_WORLD | {"world": "usual", "walk": 0}
    monkeypatch.setattr(stage, "make_world", lambda **keys: small_world if keys == asked else None)
    options = SyntheticOptions(**defaults()["synthetic"] | TINY | {"camera": "real"})
    run(tmp_path / "real", options)
    same_name = replace(ideal[0], name="synthetic_apartment_seed8")
    write_sequence(same_name, tmp_path / "ideal", jpeg_quality=IDEAL.jpeg_quality)
    folders = tmp_path / "real", tmp_path / "ideal"
    for table in ("aria_trajectory.csv", "scene_objects.csv"):
        assert len({(folder / table).read_bytes() for folder in folders}) == 1
    loops = [pd.read_csv(folder / "mps/slam/closed_loop_trajectory.csv") for folder in folders]
    assert loops[0]["tracking_timestamp_us"].equals(loops[1]["tracking_timestamp_us"])
    columns = [f"t{axis}_world_device" for axis in "xyz"]
    error = np.linalg.norm(loops[0][columns] - loops[1][columns], axis=1)
    assert 0.001 < np.sqrt((error**2).mean()) < 0.05
    assert "error of an estimate" in (tmp_path / "real/mps/slam/summary.json").read_text()

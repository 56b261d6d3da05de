"""Expected times follow the configuration, and are given only for stages whose device was measured."""

from pathlib import Path

import pytest

from egosplat.doctor.examination import duration, estimate
from egosplat.pipeline.config import defaults, merge, resolve

ROOT = Path(__file__).resolve().parents[3]


def with_keys(section: str, **keys: object) -> dict:
    return merge(defaults(), {section: keys})


def test_presets_take_longer_in_their_order():
    times = [
        estimate(resolve({"preset": name}, ROOT / "config/presets"), True)[0]
        for name in ("draft", "balanced", "accurate", "paper")
    ]
    assert times == sorted(times)


def test_the_demo_scene_takes_minutes():
    """A known point: the preset balanced took 12 minutes on two cores."""
    assert 8 < estimate(defaults(), True)[0] < 16


def test_a_real_recording_is_as_long_as_is_assumed():
    """3,600 frames of which every stride-th is used."""
    film = {"seconds": 100.0, "fps": 36.0, "size": 1}
    config = merge(defaults(), {"synthetic": film})
    assert estimate(config, False)[0] == pytest.approx(estimate(config, True)[0], abs=0.5)


def test_stages_that_run_elsewhere_are_left_out():
    on_gpu, without = estimate(with_keys("models", sam2_config="sam2.1_hiera_b+"), True, "cuda", "cuda")
    assert {"segments", "view_features", "splats", "metrics"} <= set(without) and on_gpu < 10
    on_cpu, without = estimate(with_keys("models", sam2_config="sam2.1_hiera_b+"), True)
    assert not without and on_cpu > 60


def test_a_scene_that_masks_nothing_needs_no_transient_network():
    """Unless its tracks need to know what moves."""
    unmasked = with_keys("splats", masking="none")
    for keys, needed in (({"prompting": "each_frame"}, True), ({"track_moving": "never"}, False)):
        _, on_gpu = estimate(merge(unmasked, {"segments": keys}), True, "cuda")
        assert ("transient" in on_gpu) == needed


@pytest.mark.parametrize(
    "seconds, text", [(41.2, "41 s"), (600, "10 min"), (12_600, "3.5 h"), (9e5, "250 h")]
)
def test_durations_are_written_in_a_fitting_unit(seconds, text):
    """Nobody reads 12,600 s."""
    assert duration(seconds) == text

"""Expected times follow the configuration, and are given only where something was measured."""

from pathlib import Path

import pytest

from egosplat.doctor.examination import PARTS, duration, estimate
from egosplat.pipeline.config import defaults, merge, resolve

ROOT = Path(__file__).resolve().parents[3]
PUBLISHED = {"sam2_config": "sam2.1_hiera_b+"}


def with_keys(section: str, **keys: object) -> dict:
    return merge(defaults(), {section: keys})


def test_presets_take_longer_in_their_order():
    """A preset takes at least as long as the one before it, in every part."""
    ladder = [
        estimate(resolve({"preset": name}, ROOT / "config/presets"), True, "avx512")
        for name in ("draft", "fast", "balanced", "accurate", "paper")
    ]
    for part in PARTS:
        assert sorted(times[part] for times in ladder) == [times[part] for times in ladder], part


def test_the_demo_scene_takes_minutes():
    """A known point: the preset balanced took 12 minutes on two cores, fast less."""
    assert 5 * 60 < sum(estimate(defaults(), True, "avx512").values()) < 30 * 60


def test_a_real_recording_is_not_known_before_it_is_read():
    """Parts that depend on the number of frames are not guessed."""
    real = estimate(defaults(), False, "avx2")
    assert real["filming"] == 0 and real["training"] > 0
    assert real["reading"] is None and real["segments"] is None and real["queries"] is None


def test_what_was_not_measured_is_not_known():
    """Nothing was measured on a GPU, nor of the classical segmenter's time."""
    on_gpu = estimate(with_keys("models", **PUBLISHED), True, "cuda", "cuda")
    assert on_gpu["training"] is None and on_gpu["segments"] is None and on_gpu["reading"] > 0
    assert estimate(with_keys("segments", segmenter="classical"), True, "avx512")["segments"] is None
    assert estimate(with_keys("models", **PUBLISHED), True, "avx512")["segments"] > 3600


def test_a_scene_that_masks_nothing_needs_no_transient_network():
    """A part that is skipped takes no time."""
    assert estimate(defaults(), True, "avx512")["transient"] > 0
    unmasked = with_keys("splats", masking="none")
    for keys, needed in (({"prompting": "each_frame"}, True), ({"track_moving": "never"}, False)):
        config = merge(unmasked, {"segments": keys})
        assert (estimate(config, True, "avx512")["transient"] > 0) == needed


@pytest.mark.parametrize(
    "seconds, text", [(41.2, "41 s"), (600, "10 min"), (12_600, "3.5 h"), (9e5, "250 h")]
)
def test_durations_are_written_in_a_fitting_unit(seconds, text):
    """Nobody reads 12,600 s."""
    assert duration(seconds) == text

"""Expected times follow the configuration and are given only where something was measured."""

import copy
import re
from pathlib import Path

import pytest

from egosplat.doctor.times import estimate, spoken
from egosplat.pipeline.config import defaults, resolve

ROOT = Path(__file__).resolve().parents[3]


def test_training_is_estimated_as_the_table_measured_it():
    config = copy.deepcopy(defaults())
    config["splats"]["iterations"] = 7000
    rows = (ROOT / "benchmarks/training.md").read_text().splitlines()
    cells = [row.split("|") for row in rows if row.startswith("| adt/scene")]
    measured = [float(row[11]) for row in cells]
    assert min(measured) < estimate(config, True, "avx512").splats < max(measured)


def test_presets_are_in_the_order_of_their_names():
    def seconds(preset):
        expected = estimate(resolve({"preset": preset}, ROOT / "config/presets"), True, "avx512")
        return expected.synthetic, expected.reading, expected.transient, expected.splats, expected.asking

    fast, balanced, paper = map(seconds, ("fast", "balanced", "paper"))
    assert all(a < b < c for a, b, c in zip(fast, balanced, paper, strict=True))


@pytest.mark.parametrize(
    "section, key, factor",
    [
        ("splats", "iterations", 2.0),
        ("splats", "max_gaussians", 1.7),
        ("frames", "resolution", 1.9),
    ],
)
def test_training_grows_with_what_the_schema_says_it_grows_with(section, key, factor):
    config = copy.deepcopy(defaults())
    before = estimate(config, True, "avx512").splats
    config[section][key] *= 2
    assert estimate(config, True, "avx512").splats == pytest.approx(factor * before)


def test_what_was_not_measured_is_not_known():
    assert estimate(defaults(), True, "cuda").splats is None
    real = estimate(defaults(), False, "avx2")
    assert real.synthetic == 0 and real.reading is None and real.splats > 0
    assert real.segments is None and real.asking is None
    published = defaults() | {"models": defaults()["models"] | {"sam2_config": "sam2.1_hiera_b+"}}
    assert estimate(published, True, "avx2").segments is None


def test_a_scene_that_masks_nothing_needs_no_network():
    config = copy.deepcopy(defaults())
    assert estimate(config, True, "avx512").transient > 0
    config["splats"]["masking"] = "none"
    assert estimate(config, True, "avx512").transient == 0


def test_the_segmenter_without_weights_was_not_measured():
    config = copy.deepcopy(defaults())
    config["segments"]["segmenter"] = "classical"
    assert estimate(config, True, "avx512").segments is None


def test_sam2_s_time_grows_with_the_area_of_its_picture():
    config = copy.deepcopy(defaults())
    before = estimate(config, True, "avx512").segments
    config["segments"]["image_size"] = 640
    assert estimate(config, True, "avx512").segments == pytest.approx(4 * before)


@pytest.mark.parametrize("seconds, words", [(41.2, "41 s"), (600, "10 min"), (12_600, "3.5 h")])
def test_durations_are_spoken_of_in_a_fitting_unit(seconds, words):
    assert re.fullmatch(words, spoken(seconds))

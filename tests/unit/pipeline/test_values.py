"""Every stage gets the values that it got before its options became models, for each preset, format, variant and set."""

import functools
import json
import lzma
from pathlib import Path

import pytest

from egosplat.pipeline.config import of_format, resolve, stage_values
from egosplat.pipeline.model_sets import DEFAULTS
from egosplat.pipeline.sweeps import with_points
from egosplat.pipeline.variants import variant_config

PAPER = DEFAULTS["published"]
PRESETS = Path(__file__).resolve().parents[3] / "config" / "presets"
BEFORE = json.loads(lzma.decompress((Path(__file__).parent / "data/values_before.json.xz").read_bytes()))

# Keys that became constants, with their values, by stage.
CONSTANTS = {
    "survey": {"max_moving_probability": 0.5},
    "poses": {"overlap": 12, "max_gap_ms": 50.0, "seed": 0},
    "segments": {
        "batch": 16,
        "max_covered_new": 0.5,
        "min_uncovered_fraction": 0.05,
        "box_nms_thresh": 0.7,
        "nms_iou_thresh": 0.8,
        "nms_inner_thresh": 0.5,
    },
    "instances": {"claimed": 0.5, "common": 0.2, "cut_iou": 0.5, "drop_iou": 0.3},
    "view_features": {"batch": 64},
    "tiles": {"batch": 128},
    "transient": {"checkpoint_s": 120.0},
    "splats": {"checkpoint_s": 120.0, "antialiased": False, "grow_grad2d": 0.0002, "position_lr": 0.00016},
    "language": {"checkpoint_s": 120.0, "channels": 32, "scales": 8},
    "metrics": {"confidence": 0.95, "resamples": 10000, "seed": 0},
    "method_metrics": {"confidence": 0.95, "resamples": 10000, "seed": 0},
}
# Keys of the stage segments that are fields of ``SegmentsOptions.mask_filter`` now.
FILTERS = ("pred_iou_thresh", "stability_score_thresh", "stability_score_offset", "nms_score_thresh")
# Keys that came later, by stage.
LATER = {
    "synthetic": ("world",),
    "survey": ("min_moving_share",),
    "masks": ("sure_probability",),
    "view_features": ("cut",),
    "splats": ("source",),
    "metrics": ("masks",),
    "method_metrics": ("masks",),
}
# Keys with a new name.
RENAMED = {"models-precision": "run-precision"}


@functools.cache
def scene_config(preset: str, models: str, format: str) -> dict:
    """The configuration of a scene; with the points of the trade-off under the default preset."""
    scene = of_format(resolve({"preset": preset, "models": {"set": models}}, PRESETS), format)
    return with_points(scene, PRESETS, format) if preset == "balanced" else scene


# Variants of a preset that was removed.
REMOVED = ("fast", "fast-seed-1")

# Defaults that a measurement moved.
MOVED = {"masks": {"stands_out": (0.5, 0.35)}}


def now(name: str) -> dict:
    """The values of each stage in a row of the file, today."""
    *words, variant = name.split()
    scene = scene_config(*words)
    for old, new in RENAMED.items():
        variant = variant.replace(old, new)
    config = scene if variant == "-" else variant_config(scene, variant, "test")
    return {stage: stage_values(stage, config) for stage in BEFORE["stages"]}


@pytest.mark.parametrize("preset", ["draft", "balanced", "accurate", "paper"])
def test_stages_get_the_values_they_got(preset):
    """But for keys that became constants, and seeds of the trade-off, which now reach the stage instances, too."""
    for name, numbers in BEFORE["rows"].items():
        if not name.startswith(f"{preset} ") or name.endswith(REMOVED):
            continue
        found = now(name)
        for stage, number in zip(BEFORE["stages"], numbers, strict=True):
            expected = dict(BEFORE["values"][number])
            for key, value in CONSTANTS.get(stage, {}).items():
                assert expected.pop(key) == value, (name, stage, key)
            for key in LATER.get(stage, ()):
                del found[stage][key]
            for key, (old, new) in MOVED.get(stage, {}).items():
                expected[key] = new if expected[key] == old else expected[key]
            if stage == "frames" and "draft" in name and " plain " in name and expected["resolution"] == 256:
                expected["resolution"] = 512  # preset draft, in which COLMAP oriented too few pictures
            if "paper_scaled" in name:
                # It takes the readings that come with the paper's models, too.
                readings = {
                    key: value for part in ("features", "query") for key, value in PAPER[part].items()
                }
                expected |= {key: value for key, value in readings.items() if key in expected}
            if stage == "segments":
                _check_filters(expected, found[stage])
            if stage == "instances":
                assert found[stage].pop("backend") == "auto", "it had no key for what it did"
                if expected["iterations"] == 150:  # preset draft, which needs no temporary Gaussians any more
                    assert found[stage]["iterations"] == 1000
                    expected["iterations"] = 1000
            if name.endswith("seed-1") and stage == "instances":
                assert found[stage].pop("seed") == 1
                expected.pop("seed")
            assert found[stage] == expected, (name, stage)


def _check_filters(expected: dict, found: dict) -> None:
    from egosplat.segments.options import MASK_FILTERS

    expected.pop("levels")
    filters = MASK_FILTERS[found.pop("set")]
    assert {key: expected.pop(key) for key in FILTERS} == {key: getattr(filters, key) for key in FILTERS}

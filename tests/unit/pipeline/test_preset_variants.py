"""Each preset is a variant of its name."""

from pathlib import Path

import pytest

from egosplat.pipeline.config import merge, resolve
from egosplat.pipeline.variants import preset_keys, variant_config, with_presets

PRESETS = Path(__file__).resolve().parents[3] / "config" / "presets"


def test_a_variant_of_the_configuration_keeps_its_name_from_a_preset():
    own = {"draft": {"features": {"dims": 4}}}
    found = with_presets(resolve({"variants": own}, PRESETS), PRESETS, "adt")["variants"]
    assert found["draft"] == own["draft"] and "accurate" in found


def test_presets_leave_recording_models_and_questions_to_the_scene():
    own = {
        "frames": {"resolution": 300, "focal": 400.0, "evaluation_frames": 5},
        "segments": {"merge_iou": 0.4},
    }
    base = resolve(own | {"models": {"clip_model": "mine"}}, PRESETS)
    config = with_presets(base, PRESETS, "adt")
    draft, paper = (variant_config(config, name, "adt/scene1") for name in ("draft", "paper_scaled"))
    for found in (draft, paper):
        assert (found["frames"]["focal"], found["frames"]["evaluation_frames"]) == (400.0, 5)
        assert found["models"] == base["models"] and found["metrics"] == base["metrics"]
        assert found["segments"]["merge_iou"] == 0.4 and found["synthetic"] == base["synthetic"]
    assert draft["frames"]["resolution"] == 256 and paper["frames"]["resolution"] == 300
    assert (paper["splats"]["iterations"], paper["features"]["dims"]) == (30000, 3)
    assert paper["transient"]["encoder_weights"] is None
    assert (paper["query"]["temperature"], paper["query"]["min_score"]) == (1.0, 0.0)
    assert (paper["features"]["mismatched_views"], paper["view_features"]["cut"]) == ("average", "mask")
    assert draft["query"] == base["query"] and draft["view_features"]["cut"] == "hull"


@pytest.mark.parametrize("name", ["draft", "balanced"])
@pytest.mark.parametrize("below", ["draft", "balanced", "accurate", "paper"])
def test_presets_replace_the_scenes_own_preset(name, below):
    left_to_the_scene = {"formats", "segments", "transient", "frames", "models", "synthetic", "metrics"}
    base = resolve({"preset": below}, PRESETS)
    keys = preset_keys(name, PRESETS, "adt")
    wanted = resolve({"preset": name, "models": {"set": base["models"]["set"]}}, PRESETS)
    found = merge(base, keys)
    for section in set(found) - left_to_the_scene - {"preset"}:
        assert found[section] == wanted[section], section
    assert found["frames"]["resolution"] == wanted["frames"]["resolution"]
    assert found["segments"]["points_per_side"] == wanted["segments"]["points_per_side"]

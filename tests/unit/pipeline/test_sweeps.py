"""Which points a configuration asks for, and the variants that make them."""

import re
from pathlib import Path

import pytest

from egosplat.errors import UserError
from egosplat.pipeline.config import defaults, merge, resolve, stage_values
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.sweeps import Setting, points_of, variant_name, with_points
from egosplat.pipeline.variants import owner, preset_keys, variant_config

PRESETS = Path(__file__).resolve().parents[3] / "config" / "presets"


def scene(presets=(), seeds=(), base=None, **knobs):
    """A configuration with points; knobs as ``features__dims=[8]``."""
    about = {"presets": list(presets), "seeds": list(seeds)}
    about["sweep"] = {name.replace("__", "."): values for name, values in knobs.items()}
    config = merge(base or defaults(), {})
    return with_points(config | {"tradeoff": about}, PRESETS, "adt")


@pytest.mark.parametrize(
    "knob, value, name",
    [
        ("features.dims", 8, "features-dims-8"),
        ("preset", "paper_scaled", "paper_scaled"),
        ("frames.upright", True, "frames-upright-true"),
        ("segments.image_size", None, "segments-image_size-null"),
        ("run.near_plane", -1, "run-near_plane--1"),
    ],
)
def test_a_variant_is_named_after_its_setting(knob, value, name):
    assert variant_name(Setting(knob, value)) == name


def test_names_are_safe_and_unique():
    values = ["a/b", "a.b", "a_b", "../x", "x" * 300, "x" * 301, 0.5, "0.5 ", 1e-5, "ä", ""]
    names = [variant_name(Setting("models.clip_checkpoint", value)) for value in values]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch("[A-Za-z0-9_-]{1,120}", name) for name in names)
    assert names == [variant_name(Setting("models.clip_checkpoint", value)) for value in values]


def test_a_setting_equal_to_the_scene_is_the_scene():
    dims = defaults()["features"]["dims"]
    config = scene(presets=["balanced", "draft"], seeds=[1, 2], features__dims=[8, dims])
    own, draft, narrow = points_of(config, "adt/scene1")
    assert own.variants == [None, "seed-1", "seed-2"]
    assert own.settings == [Setting("features.dims", dims), Setting("preset", "balanced")]
    assert draft.variants == ["draft", "draft-seed-1", "draft-seed-2"]
    assert narrow.settings == [Setting("features.dims", 8)]


def test_a_parameter_that_changes_nothing_is_the_scene():
    base = merge(defaults(), {"splats": {"masking": "none"}})
    (own,) = points_of(scene(base=base, masks__level=["part"]), "adt/scene1")
    assert Setting("masks.level", "part") in own.settings


def test_points_of_another_seed_share_what_they_have_in_common():
    base = merge(defaults(), {"splats": {"masking": "refined"}})
    config = scene(base=base, seeds=[1], features__dims=[8], segments__points_per_side=[8])

    def owners(name):
        stages = ("frames", "segments", "features", "transient", "masks", "splats", "language", "metrics")
        return {stage: owner(stage, config, name, "adt/scene1") for stage in stages}

    one, both = "seed-1", "features-dims-8-seed-1"
    assert owners(both) == {"frames": None} | dict.fromkeys(
        ("segments", "transient", "masks", "splats"), one
    ) | dict.fromkeys(("features", "language", "metrics"), both)
    point = "segments-points_per_side-8"
    assert owners(f"{point}-seed-1") | {"frames": None, "transient": one} == {
        "frames": None,
        "transient": one,
        **dict.fromkeys(
            ("segments", "features", "masks", "splats", "language", "metrics"), f"{point}-seed-1"
        ),
    }


def test_a_seed_changes_only_training_stages():
    config = scene(seeds=[5])
    found = variant_config(config, "seed-5", "adt/scene1")
    changed = {stage for stage in STAGES if stage_values(stage, found) != stage_values(stage, config)}
    assert changed == {"instances", "features", "transient", "splats", "language", "rests"}
    assert found["run"] == config["run"] | {"seed": 5}


def test_presets_leave_recording_models_and_questions_to_the_scene():
    own = {
        "frames": {"resolution": 300, "focal": 400.0, "evaluation_frames": 5},
        "segments": {"merge_iou": 0.4},
    }
    base = merge(defaults(), own | {"models": {"clip_model": "mine"}})
    config = scene(presets=["draft", "paper_scaled"], base=base)
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


@pytest.mark.parametrize(
    "knob, message",
    [
        ("features.dim", "no key features.dim; did you mean features.dims"),
        ("nothing.here", "no key nothing.here"),
        ("metrics.hit_region", "scores with other values of metrics.hit_region cannot be compared"),
        ("frames.evaluation_frames", "cannot be compared"),
        ("synthetic.size", "cannot be compared"),
        ("run.seed", "run.seed cannot be swept"),
    ],
)
def test_an_invalid_sweep_is_rejected(knob, message):
    with pytest.raises(UserError, match=f"tradeoff.sweep: .*{message}"):
        scene(**{knob.replace(".", "__"): [1]})


def test_a_value_that_is_not_allowed_is_named():
    with pytest.raises(UserError, match="features-dims-0: features.dims = 0"):
        points_of(scene(features__dims=[0]), "adt/scene1")


def test_the_scenes_own_seed_is_no_other_seed():
    with pytest.raises(UserError, match="adt/scene1: tradeoff.seeds: 0"):
        points_of(scene(seeds=[0]), "adt/scene1")


def test_a_variant_may_not_take_a_settings_name():
    with pytest.raises(UserError, match="features-dims-8"):
        scene(base=merge(defaults(), {"variants": {"features-dims-8": {}}}), features__dims=[8])

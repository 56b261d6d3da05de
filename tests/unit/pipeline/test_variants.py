"""Artifacts that a variant changes, and artifacts that it shares with its scene; each preset is a variant of its name."""

from pathlib import Path

import pytest

from egosplat.pipeline.config import defaults, merge, resolve
from egosplat.pipeline.dag import stages_behind
from egosplat.pipeline.scenes import Scene
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.variants import (
    artifact_path,
    method_of,
    owner,
    preset_of,
    reaches,
    scene_config,
    variant_config,
    with_presets,
)
from tests.support import PRESETS

BASE = defaults()


# Configurations in which training takes all frames, so that the survey decides masks and tracks alone.
OFF = {"camera": {"refine_poses": "off", "compensate_exposure": "off"}}
ALL_FRAMES = {"survey": {"min_view_change_deg": 0}} | OFF
TRACKED = ALL_FRAMES | {"segments": {"prompting": "initial_frame"}}
CAREFUL = {"survey": {"min_moving_share": 0.1}}
PENALTY = {"transient": {"transient_penalty": 0.1}}


@pytest.mark.parametrize(
    "scene, keys, changed, shared",
    [
        ({}, {"features": {"epochs": 2}}, "features language", "view_features splats masks"),
        ({}, {"splats": {"masking": "none"}}, "splats language", "masks features instances segments"),
        ({}, {"splats": {"masking": "refined"}}, "splats", "segments features"),
        ({}, {"splats": {"iterations": 5}}, "splats language", "instances"),
        ({}, PENALTY, "transient masks splats language segments", "survey"),
        ({}, {"segments": {"track_moving": "never"}}, "segments", "frames"),
        ({}, {"frames": {"stride": 3}}, "frames poses segments features transient splats", ""),
        ({}, {"features": {"dims": 4}}, "features language", "splats"),
        ({"splats": {"language": "joint"}}, {"features": {"dims": 4}}, "features splats", "segments"),
        ({}, {"survey": {"min_view_change_deg": 9.0}}, "segments transient splats language", "frames"),
        (ALL_FRAMES, CAREFUL, "splats language", "frames"),
        (ALL_FRAMES, PENALTY, "splats", "survey"),
        (TRACKED, CAREFUL, "splats", "segments"),
        (TRACKED | {"splats": {"masking": "refined"}}, CAREFUL, "survey", "segments splats"),
    ],
)
def test_keys_reach_their_stage_and_those_after_it_alone(scene, keys, changed, shared):
    base = merge(BASE, scene)
    reached = {name for name in STAGES if reaches(name, base, merge(base, keys))}
    assert reached >= {*changed.split()} and reached.isdisjoint(shared.split())


OVER = resolve(
    {
        "splats": {"masking": "refined"},
        "variants": {
            "short": {"splats": {"iterations": 5}},
            "narrow": {"extends": "short", "features": {"dims": 4}},
            "back": {"extends": "narrow", "features": {"dims": BASE["features"]["dims"]}},
            "dense": {"segments": {"points_per_side": 4}, "splats": {"iterations": 7}},
            "both": {"extends": ["dense", "short"]},
        },
    },
    PRESETS,
)


@pytest.mark.parametrize(
    "name, expected",
    [
        ("short", {"frames": None, "masks": None, "features": None, "splats": "short", "language": "short"}),
        ("narrow", {"frames": None, "features": "narrow", "splats": "short", "language": "narrow"}),
        ("back", {"features": None, "splats": "short", "language": "back"}),
        ("both", {"segments": "dense", "masks": "dense", "splats": "both", "language": "both"}),
    ],
)
def test_a_variant_shares_artifacts_with_its_parents(name, expected):
    assert {stage: owner(stage, OVER, name, "adt/scene1") for stage in expected} == expected
    iterations = variant_config(OVER, name, "adt/scene1")["splats"]["iterations"]
    assert iterations == 5, "of several parents the last wins"


VARIANTS = {"variants": {"narrow": {"features": {"dims": 4}}}}
SCENE = Scene("adt", "scene1", "adt", Path("results/adt/scene1/recording"), True, resolve(VARIANTS, PRESETS))


def test_an_artifact_is_in_the_folder_of_the_variant_only_where_a_key_reaches_it():
    assert artifact_path("features", SCENE, None) == "results/adt/scene1/features.zarr"
    assert artifact_path("features", SCENE, "narrow") == "results/adt/scene1/variants/narrow/features.zarr"
    assert artifact_path("segments", SCENE, "narrow") == "results/adt/scene1/segments.zarr"
    assert artifact_path("metrics", SCENE, "narrow") == "results/adt/scene1/variants/narrow/metrics.json"
    assert scene_config(SCENE, "narrow")["features"]["dims"] == 4
    assert scene_config(SCENE, None) == SCENE.config


def test_a_variant_inherits_the_method_and_the_preset_of_those_that_it_extends():
    own = {"mine": {"extends": ["draft", "baseline"]}, "like": {"extends": "langsplat"}, "draft": {}}
    config = merge(BASE, {"variants": own})
    presets = {name: preset_of(config, name, "adt/scene1") for name in (None, "baseline", "draft", "mine")}
    assert presets == {None: "balanced", "baseline": "balanced", "draft": "draft", "mine": "draft"}
    methods = [method_of(config, name, "adt/scene1") for name in ("like", "mine", "baseline")]
    assert methods == ["LangSplat", None, None]
    assert "method" not in variant_config(BASE, "langsplat", "adt/scene1")


OTHERS = [name for name, keys in BASE["variants"].items() if "method" in keys]
FEATURES = {"langsplat": "langsplat", "occam": "each_frame", "gags": "each_frame"}
"""Whose features a method takes that learns from masks of single frames."""


@pytest.mark.parametrize("name", OTHERS)
def test_other_methods_never_read_what_moves_and_share_the_geometry_without_masks(name):
    config = variant_config(BASE, name, "adt/scene1")
    read = set(stages_behind(["language"], config))
    assert read.isdisjoint({"annotations", "transient", "masks"})
    tiles = config["language"]["method"] in ("field", "quantized")
    learnt = {"tiles"} if tiles else {"segments", "instances", "features"}
    assert read & {"tiles", "segments", "instances", "features"} == learnt
    stages = ("splats", "language", "instances", "features")
    owners = [owner(stage, BASE, name, "adt/scene1") for stage in stages]
    assert owners[:2] == ["no_masks", name]
    assert name not in FEATURES or owners[2:] == ["each_frame", FEATURES[name]]
    # Those that give each Gaussian a code are asked in both ways.
    asked = f"{name}_pixels"
    assert (asked in BASE["variants"]) != tiles
    if not tiles:
        owners = [owner(stage, BASE, asked, "adt/scene1") for stage in ("language", "metrics")]
        assert owners == [name, asked]
        assert method_of(BASE, asked, "adt/scene1") == BASE["variants"][name]["method"]
    paper = resolve({"preset": "paper"}, PRESETS)
    assert paper["splats"]["language"] == "joint"
    assert variant_config(paper, name, "adt/scene1")["splats"]["language"] == "after"
    assert owner("splats", paper, name, "adt/scene1") == "shared_geometry"


def test_presets_that_suit_the_models_are_variants_but_for_names_of_the_configuration():
    """Also of a variant that chooses other models than its scene, which had crops here."""
    own = {"draft": {"features": {"dims": 4}}, "slow": {"extends": "accurate", "models": {"set": "small"}}}
    found = with_presets(resolve({"variants": own, "models": {"set": "light"}}, PRESETS), PRESETS, "adt")
    named = found["variants"]
    assert named["draft"] == own["draft"] and named["accurate"]["segments"]["crops_per_side"] == 1
    crops = [
        variant_config(found, name, "adt/scene1")["segments"]["crops_per_side"] for name in (*own, "accurate")
    ]
    assert crops == [1, BASE["segments"]["crops_per_side"], 1] != [1, 1, 1]


def test_presets_leave_recording_models_and_questions_to_the_scene():
    frames = {"resolution": 300, "stride": 3, "start_s": 2.0, "evaluation_frames": 5}
    own = {"frames": frames, "query": {"readout": "pixels"}, "instances": {"iterations": 7}}
    base = resolve(own | {"models": {"clip_model": "mine"}}, PRESETS)
    config = with_presets(base, PRESETS, "adt")
    draft, paper = (variant_config(config, name, "adt/scene1") for name in ("draft", "paper_scaled"))
    for found in (draft, paper):
        assert all(found["frames"][key] == frames[key] for key in frames.keys() - {"resolution"})
        assert all(found[section] == base[section] for section in ("models", "metrics", "synthetic"))
        assert found["instances"]["iterations"] == 7 and found["query"]["readout"] == "pixels"
    assert draft["frames"]["resolution"] == 256 and paper["frames"]["resolution"] == 300
    assert (paper["splats"]["iterations"], paper["features"]["dims"]) == (30000, 3)
    assert paper["transient"]["encoder_weights"] is None
    assert (paper["query"]["temperature"], paper["query"]["min_score"]) == (1.0, 0.0)
    assert draft["query"] == base["query"]
    assert (paper["view_features"]["cut"], draft["view_features"]["cut"]) == ("mask", "hull")

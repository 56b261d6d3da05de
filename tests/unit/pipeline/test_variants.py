"""Artifacts that a variant changes, and artifacts that it shares with its scene."""

from pathlib import Path

import pytest

from egosplat.errors import UserError
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
)

BASE = defaults()
PRESETS = Path(__file__).parents[3] / "config" / "presets"


# Configurations in which training takes all frames, so that the survey decides masks and tracks alone.
OFF = {"camera": {"refine_poses": "off", "compensate_exposure": "off"}}
ALL_FRAMES = {"survey": {"min_view_change_deg": 0}} | OFF
TRACKED = ALL_FRAMES | {"segments": {"prompting": "initial_frame"}}
CAREFUL = {"survey": {"min_moving_share": 0.1}}
PENALTY = {"transient": {"transient_penalty": 0.1}}


@pytest.mark.parametrize(
    "scene, keys, changed, shared",
    [
        ({}, {"features": {"mad_k": 2.0}}, "features language", "view_features splats masks"),
        (
            {},
            {"splats": {"masking": "none"}},
            "splats language",
            "masks transient features instances segments",
        ),
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


def test_later_parents_of_a_variant_win():
    found = variant_config(OVER, "both", "adt/scene1")
    assert (found["segments"]["points_per_side"], found["splats"]["iterations"]) == (4, 5)


@pytest.mark.parametrize(
    "name, expected",
    [
        ("short", {"frames": None, "masks": None, "features": None, "splats": "short", "language": "short"}),
        ("narrow", {"frames": None, "features": "narrow", "splats": "short", "language": "narrow"}),
        ("back", {"features": None, "splats": "short", "language": "back"}),
        (
            "both",
            {"frames": None, "segments": "dense", "masks": "dense", "splats": "both", "language": "both"},
        ),
    ],
)
def test_a_variant_shares_artifacts_with_its_parents(name, expected):
    assert {stage: owner(stage, OVER, name, "adt/scene1") for stage in expected} == expected


@pytest.mark.parametrize(
    "variants, name, message",
    [
        ({}, "mine", "no variant 'mine'.*take one of: baseline"),
        ({"mine": {"splats": {"masking": "all"}}}, "mine", r"variant mine: splats\.masking = 'all'"),
        ({"mine": {"synthetic": {"seed": 9}}}, "mine", "leave out the section synthetic"),
        ({"mine": {"preset": "draft"}}, "mine", "a variant cannot change preset"),
        ({"a": {"extends": "b"}, "b": {"extends": "a"}}, "a", "variant a: circular .* a -> b -> a"),
        (
            {"a": {"extends": ["c", "b"]}, "b": {"extends": "a"}, "c": {}},
            "a",
            "variant a: circular .* a -> b -> a",
        ),
        ({f"v{i}": {} for i in range(20)}, "mine", r", \d+ more$"),
    ],
)
def test_an_invalid_variant_is_rejected(variants, name, message):
    scene = resolve({"variants": variants}, PRESETS)
    with pytest.raises(UserError, match=message):
        variant_config(scene, name, "adt/scene1")


VARIANTS = {"variants": {"narrow": {"features": {"dims": 4}}}}
SCENE = Scene("adt", "scene1", "adt", Path("results/adt/scene1/recording"), True, resolve(VARIANTS, PRESETS))


def test_an_artifact_is_in_the_folder_of_the_variant_only_where_a_key_reaches_it():
    """Protects the paths of rules: a variant shares artifacts of its scene."""
    assert artifact_path("features", SCENE, None) == "results/adt/scene1/features.zarr"
    assert artifact_path("features", SCENE, "narrow") == "results/adt/scene1/variants/narrow/features.zarr"
    assert artifact_path("segments", SCENE, "narrow") == "results/adt/scene1/segments.zarr"
    assert artifact_path("metrics", SCENE, "narrow") == "results/adt/scene1/variants/narrow/metrics.json"
    assert (
        scene_config(SCENE, "narrow")["features"]["dims"] == 4 and scene_config(SCENE, None) == SCENE.config
    )


def test_a_variant_inherits_the_name_of_a_method_and_configurations_have_no_such_key():
    mine = {"extends": "langsplat", "language": {"iterations": 9}}
    extending = merge(BASE, {"variants": {"mine": mine}})
    assert method_of(extending, "mine", "adt/scene1") == "LangSplat"
    assert method_of(BASE, "baseline", "adt/scene1") is None
    assert "method" not in variant_config(BASE, "langsplat", "adt/scene1")


def test_the_preset_of_a_variant_is_that_which_it_extends():
    own = merge(BASE, {"variants": {"draft": {}, "mine": {"extends": ["draft", "baseline"]}}})
    named = {name: preset_of(own, name, "adt/scene1") for name in (None, "baseline", "draft", "mine")}
    assert named == {None: "balanced", "baseline": "balanced", "draft": "draft", "mine": "draft"}


OTHERS = [name for name, keys in BASE["variants"].items() if "method" in keys]


@pytest.mark.parametrize("name", OTHERS)
def test_other_methods_never_read_what_moves_and_share_the_geometry_without_masks(name):
    """Nor annotations, which only the scores read."""
    config = variant_config(BASE, name, "adt/scene1")
    read = set(stages_behind(["language"], config))
    assert read.isdisjoint({"annotations", "transient", "masks"})
    learnt = (
        {"tiles"}
        if config["language"]["method"] in ("field", "quantized")
        else {"segments", "instances", "features"}
    )
    assert read & {"tiles", "segments", "instances", "features"} == learnt
    assert owner("splats", BASE, name, "adt/scene1") == "no_masks"
    assert owner("language", BASE, name, "adt/scene1") == name


def test_other_methods_train_their_codes_after_geometry_that_they_share_also_where_egosplat_trains_both_together():
    paper = resolve({"preset": "paper"}, PRESETS)
    assert paper["splats"]["language"] == "joint"
    for name in OTHERS:
        assert variant_config(paper, name, "adt/scene1")["splats"]["language"] == "after"
        assert owner("splats", paper, name, "adt/scene1") == "shared_geometry"


def test_methods_on_masks_of_single_frames_share_them():
    for name in ("langsplat", "occam", "gags"):
        assert owner("instances", BASE, name, "adt/scene1") == "each_frame"
    assert owner("features", BASE, "langsplat", "adt/scene1") == "langsplat"
    assert owner("features", BASE, "occam", "adt/scene1") == "each_frame"

"""Inputs of stages and decisions of a survey, without Snakemake."""

import json

import pytest

from egosplat.errors import UserError
from egosplat.pipeline.config import Layer, configure, defaults, merge, section_keys
from egosplat.pipeline.dag import (
    ALL_FRAMES,
    count_chunks,
    decide,
    decided_by_survey,
    default_pages,
    follows_survey,
    inputs_of,
    leaves_frames_out,
    merges_masks,
    merges_on_splats,
    optional_inputs_of,
    options_json,
    stages_behind,
    story_stages,
    training_frames,
)
from egosplat.pipeline.stages import STAGES, load_module
from egosplat.pipeline.variants import reaches

BASE = defaults()
METHODS = section_keys("language")["method"]["enum"]
OFF = {"camera": {"refine_poses": "off", "compensate_exposure": "off"}}
EVERY_FRAME = merge(BASE, {"survey": {"min_view_change_deg": 0}} | OFF)
SINGLE_FRAMES = merge(EVERY_FRAME, {"segments": {"prompting": "each_frame", "track_moving": "auto"}})
TRACKS = merge(EVERY_FRAME, {"segments": {"prompting": "initial_frame"}})


def survey(masking):
    """The parts of a survey that decide something."""
    return {
        "motion": {"masking": masking},
        "camera": {"refine_poses": True, "compensate_exposure": False},
        "views": {"kept": [0, 1], "digest": "of-kept-frames"},
        "poses": {"frames": 4},
    }


@pytest.mark.parametrize(
    "masking, language, expected",
    [
        ("none", "after", ()),
        ("initial", "after", ("transient",)),
        ("refined", "joint", ("masks", "instances", "features")),
    ],
)
def test_the_inputs_of_splats_depend_on_their_keys(masking, language, expected):
    """Protects the DAG: masking and joint codes each add inputs."""
    config = merge(EVERY_FRAME, {"splats": {"masking": masking, "language": language}})
    assert optional_inputs_of("splats", config) == expected
    assert inputs_of("splats", config) == ("frames", "poses", *expected)
    moving = tuple(name for name in expected if name in ("transient", "masks"))
    assert optional_inputs_of("language", config) == (*moving, "instances", "features")


def learns_from_tiles(method):
    """What the module of a method says itself."""
    return [schema.name for schema in load_module("language", method).METHOD.learns_from] == ["tiles"]


@pytest.mark.parametrize("method", METHODS)
def test_codes_and_their_scores_read_what_the_method_learns_from(method):
    """Protects the table of the DAG, which cannot import the methods, and joint training, which has its own codes."""
    keys = {"language": {"method": method}, "splats": {"masking": "none"}}
    config = merge(EVERY_FRAME, keys)
    tiles = learns_from_tiles(method)
    assert optional_inputs_of("language", config) == (("tiles",) if tiles else ("instances", "features"))
    histories = ("histories",) if method == "lifted" else ()
    for stage in ("metrics", "queries_sheet"):
        assert optional_inputs_of(stage, config) == (*histories, "tiles" if tiles else "features")
    assert optional_inputs_of("splats", config) == ()
    joint = merge(config, {"splats": {"language": "joint"}})
    assert optional_inputs_of("language", joint) == ("instances", "features")


@pytest.mark.parametrize("stage", ["segments", "transient", "splats", "language"])
def test_training_stages_read_the_survey_where_it_leaves_frames_out(stage):
    """Protects the list of stages that follow kept frames."""
    assert "survey" in optional_inputs_of(stage, BASE)
    assert "survey" not in optional_inputs_of(stage, EVERY_FRAME)
    assert leaves_frames_out(BASE) and not leaves_frames_out(EVERY_FRAME)


@pytest.mark.parametrize(
    "keys, expected",
    [
        ({}, ("transient", "survey")),
        ({"track_moving": "always"}, ("transient",)),
        ({"track_moving": "never"}, ()),
        ({"prompting": "initial_frame", "track_moving": "always"}, ()),
        ({"segmenter": "classical"}, ()),
    ],
)
@pytest.mark.parametrize("masking", ["none", "initial", "refined", "auto"])
def test_segments_need_to_know_what_moves_where_only_that_is_tracked(keys, expected, masking):
    """Protects the DAG of segments, which is the same for every splats.masking: variants share the segments."""
    config = merge(SINGLE_FRAMES, {"segments": keys, "splats": {"masking": masking}})
    assert inputs_of("segments", config) == ("frames", *expected)
    assert (("segments", "track_moving") in decided_by_survey(config)) == ("survey" in expected)
    assert "survey" in optional_inputs_of("segments", merge(config, {"survey": {"min_view_change_deg": 3}}))


@pytest.mark.parametrize("masking, expected", [("refined", "always"), ("none", "never")])
def test_the_survey_decides_whether_what_moves_is_tracked(masking, expected):
    """Protects the decision, also where splats.masking is set, and a value that is set."""
    config = merge(SINGLE_FRAMES, {"splats": {"masking": "none"}})
    found = decide(config, survey(masking))
    assert found["segments"]["track_moving"] == expected and found["splats"]["masking"] == "none"
    assert ("transient" in optional_inputs_of("segments", found)) == (expected == "always")
    assert json.loads(options_json("segments", found))["track_moving"] == expected
    for value in ("always", "never"):
        own = merge(config, {"segments": {"track_moving": value}})
        assert decide(own, survey(masking)) == own and not decided_by_survey(own)


@pytest.mark.parametrize("masking", ["none", "refined"])
def test_the_survey_decides_masking_where_it_is_auto(masking):
    """Protects the decision, and the inputs and flags that follow from it."""
    found = decide(BASE, survey(masking))
    assert found["splats"]["masking"] == masking and BASE["splats"]["masking"] == "auto"
    assert ("masks" in optional_inputs_of("splats", found)) == (masking == "refined")
    assert json.loads(options_json("splats", found))["masking"] == masking


@pytest.mark.parametrize("stage", ["transient", "instances", "splats"])
def test_the_survey_decides_what_is_corrected_where_it_is_auto(stage):
    """Protects the decision and the DAG of the section camera, for every stage that trains Gaussians, and no other."""
    auto = merge(TRACKS, {"camera": BASE["camera"], "splats": {"masking": "none"}})
    assert inputs_of(stage, auto)[-1] == "survey" and "survey" not in inputs_of(stage, merge(auto, OFF))
    assert "survey" not in optional_inputs_of(stage, auto) and "survey" not in inputs_of("masks", auto)
    found = decide(auto, survey("none"))
    assert found["camera"] == {"refine_poses": "on", "compensate_exposure": "off"} and follows_survey(stage)
    assert found["camera"].items() <= json.loads(options_json(stage, found)).items()
    assert decided_by_survey(auto) and not decided_by_survey(merge(auto, OFF))
    by_hand = merge(auto, {"camera": {"refine_poses": "off", "compensate_exposure": "on"}})
    assert decide(by_hand, survey("none")) == by_hand


@pytest.mark.parametrize(
    "stage, keys, found, expected",
    [
        ("segments", {}, "none", "of-kept-frames"),
        ("splats", {}, "none", ALL_FRAMES),
        ("splats", {"splats": {"masking": "none"}}, "refined", "of-kept-frames"),
        ("splats", {"splats": {"masking": "refined"}}, "none", "of-kept-frames"),
        ("splats", {}, "refined", "of-kept-frames"),
    ],
)
def test_gaussians_train_on_all_frames_where_nothing_is_masked(stage, keys, found, expected):
    """Protects the parameter that reruns a rule when its training frames change."""
    assert training_frames(stage, merge(BASE, keys), survey(found)) == expected
    assert training_frames(stage, merge(EVERY_FRAME, keys), survey(found)) == ALL_FRAMES


@pytest.mark.parametrize(
    "stage, keys, frames, expected",
    [
        ("segments", {}, 500, 0),
        ("segments", {}, 501, 2),
        ("segments", {"segments": {"prompting": "initial_frame"}}, 501, 0),
        ("view_features", {"view_features": {"max_views": 20}}, 36_000, 0),
        ("tiles", {}, 1001, 3),
    ],
)
def test_a_long_recording_has_chunks_where_a_stage_treats_frames_apart(stage, keys, frames, expected):
    found = survey("none") | {"poses": {"frames": frames}}
    assert count_chunks(stage, merge(BASE, keys), found) == expected


@pytest.mark.parametrize(
    "keys, moving, drawn",
    [
        ({}, "refined", True),
        ({}, "none", False),
        ({"splats": {"masking": "none"}}, "refined", True),
        ({"splats": {"source": "point_cloud.ply"}}, "refined", True),
        ({"segments": {"track_moving": "always"}}, "none", True),
    ],
)
def test_carries_are_drawn_and_told_where_what_moves_is_tracked(keys, moving, drawn):
    """Protects scenes where nothing is tracked because it moves from a page of carries, and those of tiles from its instances."""
    config = decide(merge(BASE, keys), survey(moving))
    assert ("carries.png" in default_pages(config)) == drawn
    told = story_stages(config, annotated=True, surveyed=True)
    assert ({"histories", "carries_sheet"} <= set(told), "histories" in told) == (drawn, drawn)
    always = keys.get("segments") == {"track_moving": "always"}
    assert ("carries.png" in default_pages(merge(BASE, keys))) == always, "before the survey decides"


@pytest.mark.parametrize(
    "keys, moving, shown",
    [
        ({}, "refined", True),
        ({"language": {"method": "center"}}, "refined", False),
        ({"segments": {"track_moving": "always"}}, "none", True),
        ({"segments": {"track_moving": "never"}}, "refined", False),
        ({"segments": {"prompting": "initial_frame"}}, "refined", False),
    ],
)
def test_scores_and_pages_are_of_a_time_where_what_moves_is_tracked(keys, moving, shown):
    """Protects methods of others, whose codes mean nothing by Gaussian, and joint training from hours of rests."""
    undecided = merge(BASE, keys)
    config = decide(undecided, survey(moving))
    for stage in ("metrics", "queries_sheet", "scene_page"):
        assert ("histories" in optional_inputs_of(stage, config)) == shown
        # The survey must run before it is known whether anything is tracked.
        is_open = ("segments", "track_moving") in decided_by_survey(undecided)
        waits = is_open and "histories" in optional_inputs_of(stage, undecided)
        assert "survey" in inputs_of(stage, undecided) or not waits
    assert ("histories" in stages_behind(["metrics"], config)) == shown


OF_INSTANCES = {"segments", "instances", "view_features", "features"}


@pytest.mark.parametrize("method", METHODS)
def test_pages_and_story_make_instances_only_where_something_reads_them(method):
    """Protects a scene whose own method learns from tiles from hours of segmentation, also where the survey decides masks."""
    config = merge(EVERY_FRAME, {"language": {"method": method}, "splats": {"masking": "none"}})
    tiles = learns_from_tiles(method)
    told = set(story_stages(config, annotated=True, surveyed=False))
    assert told & (OF_INSTANCES | {"tiles"}) == ({"tiles"} if tiles else OF_INSTANCES)
    for one in (config, merge(config, {"splats": {"masking": "auto"}})):
        assert ({"instances.png", "crops.png", "scene.html"} & set(default_pages(one)) == set()) == tiles
    drawn = {name for name in told if STAGES[name].output in default_pages(config)}
    assert {STAGES[name].output for name in drawn} == set(default_pages(config)) - {"story.html"}


def test_a_story_tells_of_instances_that_only_masks_read():
    """Masks of what moves are instances, whatever codes are learnt from."""
    config = merge(EVERY_FRAME, {"language": {"method": "field"}, "splats": {"masking": "refined"}})
    told = story_stages(config, annotated=False, surveyed=True)
    assert {"segments", "instances", "masks", "transient_sheet", "tiles", "survey"} <= set(told)
    assert set(told).isdisjoint({"features", "instances_sheet", "scene_page", "metrics"})
    assert len(told) == len(set(told))


SOURCE = {"splats": {"source": "point_cloud.ply"}}


@pytest.mark.parametrize("masking", ["none", "initial", "refined", "auto"])
def test_gaussians_of_another_program_stand_before_what_is_merged_on_them(masking):
    """No training, so no masks before it; masks of what moves still hide it from the codes. The graph has no cycle."""
    config = merge(BASE, {"splats": SOURCE["splats"] | {"masking": masking}})
    assert "splats" in inputs_of("instances", config) and optional_inputs_of("splats", config) == ()
    assert set(inputs_of("splats", config)) - {"survey"} == {"frames", "poses"}
    assert (set(inputs_of("language", config)) >= {"masks"}) == (masking in ("refined", "auto"))
    order = stages_behind(["metrics"], config)
    assert not reaches("metrics", config, config) and {"instances", "splats"} <= set(order)
    assert training_frames("splats", config, survey("refined")) == ALL_FRAMES
    assert "splats" not in inputs_of("instances", BASE)


@pytest.mark.parametrize(
    "keys, masking, on_splats",
    [
        ({}, "none", True),
        ({"splats": {"masking": "none"}}, "none", True),
        ({"segments": {"track_moving": "never"}}, "none", True),
        ({}, "refined", False),
        # Variants without masks share the instances of their scene.
        ({"splats": {"masking": "none"}}, "refined", False),
        ({"splats": {"language": "joint"}}, "none", False),
        ({"segments": {"track_moving": "always"}}, "none", False),
        ({"segments": {"prompting": "initial_frame"}}, "none", False),
        ({"instances": {"source": "tracks"}}, "none", False),
    ],
)
def test_masks_are_merged_on_the_scenes_gaussians_where_nothing_is_tracked_or_masked(
    keys, masking, on_splats
):
    """Gaussians are trained once there. Before the survey has decided, instances wait for it; the graph has no cycle."""
    undecided = merge(SINGLE_FRAMES, keys)
    assert "splats" not in inputs_of("instances", undecided)
    waits = "survey" in inputs_of("instances", merge(undecided, {"splats": {"masking": "auto"}}))
    assert waits == merges_masks(undecided)
    config = decide(undecided, survey(masking))
    assert ("splats" in inputs_of("instances", config)) == merges_on_splats(config) == on_splats
    assert {"instances", "splats"} <= set(stages_behind(["metrics"], config))
    assert not reaches("metrics", config, config)


@pytest.mark.parametrize(
    "keys, named",
    [
        ({"camera": {"refine_poses": "on"}}, "camera.refine_poses = off, not on"),
        ({"camera": {"compensate_exposure": "on"}}, "camera.compensate_exposure = off, not on"),
        ({"splats": {"language": "joint"}}, "splats.language = after, not joint"),
    ],
)
def test_keys_that_train_contradict_trained_gaussians(keys, named):
    with pytest.raises(UserError, match=f"splats.source: .*{named}"):
        configure([Layer("mine", SOURCE), Layer("mine", keys)])

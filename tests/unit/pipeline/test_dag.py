"""Inputs of stages and decisions of a survey, without Snakemake."""

import json

import pytest

from egosplat.pipeline.config import defaults, merge, parse_options, section_keys
from egosplat.pipeline.dag import (
    ALL_FRAMES,
    count_chunks,
    decide,
    decided_by_survey,
    default_pages,
    follows_survey,
    inputs_of,
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
MASKINGS = section_keys("splats")["masking"]["enum"]
OFF = {"camera": {"refine_poses": "off", "compensate_exposure": "off"}}
EVERY_FRAME = merge(BASE, {"survey": {"min_view_change_deg": 0}} | OFF)


def survey(masking: str, frames: int = 4) -> dict[str, dict]:
    """The parts of a survey that decide something."""
    return {
        "motion": {"masking": masking},
        "camera": {"refine_poses": True, "compensate_exposure": False},
        "views": {"kept": [0, 1], "digest": "of-kept-frames"},
        "cells": [],
        "poses": {"frames": frames},
    }


@pytest.mark.parametrize(
    "stage, keys, more",
    [
        ("splats", "", "masks survey"),
        ("splats", "splats.masking=none", ""),
        ("splats", "splats.masking=initial", "transient"),
        ("splats", "splats.masking=refined splats.language=joint", "masks instances features"),
        ("splats", "splats.masking=none survey.min_view_change_deg=3", "survey"),
        ("splats", "splats.masking=none camera.refine_poses=auto", "survey"),
        ("splats", "splats.source=a.ply", "survey"),
        ("language", "splats.masking=none", "instances features"),
        ("language", "splats.masking=initial", "transient instances features"),
        ("language", "splats.masking=refined", "masks instances features"),
        ("language", "splats.source=a.ply", "masks instances features survey"),
        ("language", "splats.masking=none language.method=field", "tiles"),
        # Joint training has its own codes.
        ("language", "splats.masking=none splats.language=joint language.method=field", "instances features"),
        ("language", "splats.masking=none survey.min_view_change_deg=3", "survey instances features"),
        # Variants share the segments.
        *(("segments", f"splats.masking={one}", "poses transient survey") for one in MASKINGS),
        ("segments", "segments.track_moving=always", "poses transient"),
        ("segments", "segments.track_moving=never", "poses"),
        ("segments", "segments.track_moving=always segments.prompting=initial_frame", ""),
        ("segments", "segments.segmenter=classical", ""),
        ("segments", "segments.segmenter=classical survey.min_view_change_deg=3", "survey"),
        ("transient", "", ""),
        ("transient", "camera.refine_poses=auto", "survey"),
        ("transient", "survey.min_view_change_deg=3", "survey"),
        ("masks", "camera.refine_poses=auto", ""),
        ("instances", "", "survey"),
        ("instances", "splats.masking=none", "survey"),
        ("instances", "splats.masking=none segments.track_moving=never", "splats"),
        ("instances", "segments.prompting=initial_frame", ""),
        ("instances", "segments.prompting=initial_frame camera.refine_poses=auto", "survey"),
        ("instances", "instances.source=tracks", ""),
        ("instances", "splats.source=a.ply", "splats survey"),
        ("metrics", "", "histories features survey"),
        ("metrics", "segments.track_moving=always", "histories features"),
        ("metrics", "segments.track_moving=never", "features"),
        ("metrics", "language.method=center", "features"),
        ("metrics", "language.method=field", "tiles"),
        ("queries_sheet", "", "histories features survey"),
        ("queries_sheet", "language.method=field", "tiles"),
        ("scene_page", "", "histories survey"),
    ],
)
def test_a_stage_reads_what_its_keys_need_and_waits_for_the_survey_where_it_decides(stage, keys, more):
    config = merge(EVERY_FRAME, parse_options(keys, "keys"))
    assert inputs_of(stage, config) == (*STAGES[stage].inputs, *more.split())
    assert not reaches("metrics", config, config), "the graph has no cycle"


@pytest.mark.parametrize(
    "keys, moving, facts",
    [
        ("", "refined", "tracks masks carries histories"),
        ("", "none", "on_splats every_frame"),
        ("splats.masking=none", "refined", "tracks carries histories"),
        ("splats.masking=none", "none", "on_splats every_frame"),
        ("splats.masking=refined", "none", "masks"),
        ("segments.track_moving=always", "none", "tracks carries histories every_frame"),
        ("segments.track_moving=never", "refined", "masks"),
        ("segments.track_moving=never", "none", "on_splats every_frame"),
        ("segments.prompting=initial_frame", "refined", "masks"),
        ("segments.prompting=initial_frame", "none", "every_frame"),
        ("splats.language=joint", "none", "every_frame"),
        ("splats.language=joint", "refined", "tracks masks carries"),
        ("instances.source=tracks", "none", "every_frame"),
        ("language.method=center", "refined", "tracks masks carries"),
        ("language.method=field", "refined", "tracks masks"),
        ("splats.source=a.ply", "refined", "tracks carries histories on_splats every_frame"),
        ("splats.source=a.ply", "none", "on_splats every_frame"),
    ],
)
def test_what_moves_is_masked_tracked_and_told_and_the_rest_is_merged_on_the_scenes_gaussians(
    keys, moving, facts
):
    """Methods of others have no histories: their codes mean nothing by Gaussian. Those that learn from tiles have no instances."""
    undecided = merge(BASE, parse_options(keys, "keys"))
    config = decide(undecided, survey(moving))
    told = set(story_stages(config, annotated=True, surveyed=True))
    found = {
        "tracks": config["segments"]["track_moving"] == "always",
        "masks": "masks" in optional_inputs_of("splats", config),
        "carries": "carries.png" in default_pages(config),
        "histories": "histories" in stages_behind(["metrics"], config),
        "on_splats": "splats" in inputs_of("instances", config),
        "every_frame": training_frames("splats", config, survey(moving)) == ALL_FRAMES,
    }
    assert " ".join(fact for fact, holds in found.items() if holds) == facts
    assert ({"histories", "carries_sheet"} <= told) == ("carries" in facts) == ("histories" in told)
    assert ("carries.png" in default_pages(undecided)) == (undecided["segments"]["track_moving"] == "always")
    assert training_frames("segments", config, survey(moving)) == "of-kept-frames"
    every = merge(config, {"survey": {"min_view_change_deg": 0}})
    assert training_frames("splats", every, survey(moving)) == ALL_FRAMES


@pytest.mark.parametrize("moving, track", [("refined", "always"), ("none", "never")])
def test_the_survey_decides_what_is_auto_and_nothing_else(moving, track):
    found = decide(BASE, survey(moving))
    assert BASE["splats"]["masking"] == "auto", "a configuration is not edited in place"
    options = {stage: json.loads(options_json(stage, found)) for stage in STAGES}
    assert options["segments"]["track_moving"] == track and options["splats"]["masking"] == moving
    for stage in ("transient", "instances", "splats"):
        assert follows_survey(stage)
        assert (options[stage]["refine_poses"], options[stage]["compensate_exposure"]) == ("on", "off")
    camera = {"refine_poses": "off", "compensate_exposure": "on"}
    for set_by_hand in ("always", "never"):
        keys = {"camera": camera, "segments": {"track_moving": set_by_hand}, "splats": {"masking": "none"}}
        own = merge(BASE, keys)
        assert decide(own, survey(moving)) == own and not decided_by_survey(own)


@pytest.mark.parametrize(
    "stage, keys, frames, expected",
    [
        ("segments", "", 500, 0),
        ("segments", "", 501, 2),
        ("segments", "segments.prompting=initial_frame", 501, 0),
        ("view_features", "view_features.max_views=20", 36_000, 0),
        ("tiles", "", 1001, 3),
    ],
)
def test_a_long_recording_has_chunks_where_a_stage_treats_frames_apart(stage, keys, frames, expected):
    config = merge(BASE, parse_options(keys, "keys"))
    assert count_chunks(stage, config, survey("none", frames)) == expected


OF_INSTANCES = {"segments", "instances", "view_features", "features"}


@pytest.mark.parametrize("method", METHODS)
def test_instances_are_made_and_told_only_where_the_method_learns_from_them(method):
    """The DAG cannot import the methods, which say themselves what they learn from."""
    tiles = [schema.name for schema in load_module("language", method).METHOD.learns_from] == ["tiles"]
    config = merge(EVERY_FRAME, {"language": {"method": method}, "splats": {"masking": "none"}})
    assert ("tiles" in optional_inputs_of("language", config)) == tiles
    told = set(story_stages(config, annotated=True, surveyed=False))
    assert told & (OF_INSTANCES | {"tiles"}) == ({"tiles"} if tiles else OF_INSTANCES)
    for one in (config, merge(config, {"splats": {"masking": "auto"}})):
        assert ({"instances.png", "crops.png", "scene.html"} & set(default_pages(one)) == set()) == tiles
    drawn = {name for name in told if STAGES[name].output in default_pages(config)}
    assert {STAGES[name].output for name in drawn} == set(default_pages(config)) - {"story.html"}


def test_a_story_tells_of_instances_that_only_masks_read():
    config = merge(EVERY_FRAME, {"language": {"method": "field"}, "splats": {"masking": "refined"}})
    told = story_stages(config, annotated=False, surveyed=True)
    assert {"segments", "instances", "masks", "transient_sheet", "tiles", "survey"} <= set(told)
    assert set(told).isdisjoint({"features", "instances_sheet", "scene_page", "metrics"})
    assert len(told) == len(set(told))

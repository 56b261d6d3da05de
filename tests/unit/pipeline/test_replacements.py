"""A run lists exactly the results that it replaces, before it begins, and says how to keep both."""

import json
from pathlib import Path

import pytest

from egosplat.pipeline import config
from egosplat.pipeline.dag import decided_by_survey
from egosplat.pipeline.replacements import Asked, find_replaced, replacement_notices, stages_of
from egosplat.pipeline.stages import PIPELINE, STAGES
from egosplat.pipeline.sweeps import with_points

PRESETS = Path(__file__).resolve().parents[3] / "config" / "presets"
MADE = PIPELINE[1:]
ALL = ("metrics.json", "splats.png")


def resolved(**user):
    return with_points(config.resolve(user, PRESETS), PRESETS, "adt")


TRACKS = {"segments": {"prompting": "key_frames"}}
SINGLE_FRAMES = {"segments": {"prompting": "each_frame"}}


@pytest.fixture
def scene(tmp_path):
    """``scene(now, goals=, variant=, **made)``: what is asked for, where all was made with the keys ``made``."""

    def make(now, goals=ALL, variant=None, **made):
        folder = tmp_path / "results/adt/scene1"
        folder.mkdir(parents=True)
        before = resolved(**made)
        for stage in MADE:
            options = config.stage_values(stage, before)
            # By the survey.
            options |= {"masking": "refined"} if "masking" in options else {}
            options |= (
                {"track_moving": "always"} if (stage, "track_moving") in decided_by_survey(before) else {}
            )
            record(folder, stage, {"provenance": {"stage": stage, "options": options}})
        return Asked(
            folder,
            variant,
            goals,
            resolved(**now),
            lambda stage: path(folder, stage),
            lambda preset: resolved(**{**now, "preset": preset}),
        )

    return make


def path(folder, stage):
    return folder / STAGES[stage].output


def record(folder, stage, attributes):
    """Write an artifact's attributes, without any array."""
    file = path(folder, stage)
    if file.suffix == ".zarr":
        file.mkdir()
        file, attributes = file / "zarr.json", {"attributes": {"egosplat": attributes}}
    file.write_text(json.dumps(attributes))


# What the preset accurate makes otherwise than balanced.
ACCURATE = {"frames", "segments", "transient", "splats"}


@pytest.mark.parametrize(
    "made, now, goals, replaced",
    [
        ({}, {"preset": "accurate"}, ALL, ACCURATE),
        ({"preset": "accurate"}, {}, ALL, ACCURATE),
        (TRACKS, {"preset": "accurate"} | TRACKS, ("instances.png",), {"frames", "segments"}),
        (
            SINGLE_FRAMES,
            {"preset": "accurate"} | SINGLE_FRAMES,
            ("instances.png",),
            {"frames", "segments", "transient"},
        ),
        ({}, {"preset": "accurate"}, ("contact_sheet.png",), {"frames"}),
        ({}, {"splats": {"iterations": 9}}, ALL, {"splats"}),
        ({}, {"splats": {"iterations": 9}}, ("features.zarr",), set()),
        ({}, {"splats": {"iterations": 9}}, ("tradeoff/tradeoff.html",), {"splats"}),
        ({}, {"query": {"box_filter": 0.0}}, ALL, {"metrics"}),
        ({}, {"query": {"box_filter": 0.0}}, ("splats.png",), set()),
        ({}, {"run": {"precision": "float32"}}, ALL, {"segments", "view_features", "rests", "metrics"}),
        ({"preset": "accurate"}, {"preset": "accurate"}, ALL, set()),
        ({}, {"preset": "balanced", "splats": {"iterations": 3000}}, ALL, set()),
        ({}, {"data_root": {"adt": "/x"}, "tradeoff": {"seeds": []}}, ALL, set()),
        ({}, {"splats": {"masking": "none"}}, ("splats.png",), {"splats"}),
    ],
)
def test_the_artifacts_that_were_made_with_other_keys_are_named(scene, made, now, goals, replaced):
    asked = scene(now, goals, **made)
    found = find_replaced(asked)
    assert {artifact.stem for artifact in (found.artifacts if found else ())} == replaced
    assert len(replacement_notices([asked])) == (2 if replaced else 0)


def test_another_preset_is_named_with_its_variant(scene):
    asked = scene({"preset": "accurate"})
    told, way = replacement_notices([asked])
    assert told.startswith(f"{asked.folder}: this run replaces frames.zarr, transient.zarr, segments.zarr,")
    assert (
        "preset balanced -> accurate" in told
        and "frames.resolution 512 -> 704" in told
        and "more keys" in told
    )
    assert way.endswith(
        f"with preset balanced: snakemake --cores 2 {asked.folder}/variants/accurate/metrics.json"
    )


def test_a_synthetic_recording_of_another_preset_is_replaced_too(scene):
    asked = scene({"preset": "paper"})
    assert "recording" not in replacement_notices([asked])[0].partition("replaces")[2]
    (asked.folder / "recording").mkdir()
    told = replacement_notices([asked])[0]
    assert "this run replaces recording, frames.zarr" in told and "synthetic.size 704 -> 1408" in told


def test_the_variant_that_is_named_is_one_that_there_is(scene):
    """The presets compared in the section tradeoff are variants; one that is left out is none."""
    now = {"preset": "accurate", "tradeoff": {"presets": ["balanced"], "sweep": {}}}
    asked = scene(now)
    assert "accurate" not in asked.config["variants"]
    assert "variants/NAME/metrics.json" in replacement_notices([asked])[1]
    assert "paper_scaled" in resolved(preset="paper")["variants"]


def test_other_keys_are_given_as_a_variant_would_have_them(scene):
    asked = scene({"splats": {"iterations": 9, "densify_init": False}})
    told, way = replacement_notices([asked])
    assert "preset" not in told and "splats.iterations 3000 -> 9" in told
    assert "variants: {NAME: {splats: {iterations: 9, densify_init: false}}}" in way or (
        "variants: {NAME: {splats: {densify_init: false, iterations: 9}}}" in way
    )
    assert f"{asked.folder}/variants/NAME/metrics.json" in way


def test_many_scenes_are_counted(scene):
    asked = scene({"preset": "accurate"})
    lines = replacement_notices([asked] * 7)
    assert len(lines) == 6 and lines[4] == "and results of 3 more scenes"


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"attributes": {"egosplat": 3}}', "{"])
def test_an_artifact_that_cannot_be_read_is_left_to_its_reader(scene, content):
    asked = scene({"preset": "accurate"}, ("frames.zarr",))
    (asked.folder / "frames.zarr/zarr.json").write_text(content)
    assert replacement_notices([asked]) == []


def test_missing_artifacts_are_not_listed_as_replaced(tmp_path):
    asked = Asked(tmp_path, None, ALL, resolved(), lambda stage: path(tmp_path, stage), lambda _: resolved())
    assert replacement_notices([asked]) == []


def test_the_stages_of_the_scores_are_those_that_they_are_made_from():
    assert stages_of(["metrics.json"], resolved())[-1] == "metrics"
    assert set(MADE) == set(stages_of(["metrics.json", "carries.zarr"], resolved()))
    assert stages_of(["frames.zarr", "recording", "nothing.png"], resolved()) == ["frames"]
    assert all(stage in STAGES for stage in stages_of(["queries.png"], resolved()))

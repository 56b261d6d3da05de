"""Inputs and parameters of jobs, without Snakemake."""

import json
import os
import shlex
from dataclasses import replace
from pathlib import Path

import pytest

from egosplat.errors import UserError
from egosplat.pipeline.config import merge, resolve
from egosplat.pipeline.scenes import Scene, default_scenes
from egosplat.pipeline.stages import STAGES
from egosplat.run import jobs
from egosplat.run.jobs import Job, default_results, results_by_survey
from tests.support import PRESETS
from tests.unit.pipeline.test_dag import survey

VARIANTS = {"v": {"features": {"dims": 4}}, "still": {"splats": {"masking": "none"}}}
CONFIG = resolve({"variants": VARIANTS}, PRESETS)


@pytest.fixture
def scenes(folder):
    """A synthetic scene, a recording that exists, one that does not, and a scene that is made by name alone."""
    Path("clip.mp4").touch()
    rows = [
        Scene("adt", "one", "adt", Path("results/adt/one/recording"), True, CONFIG),
        Scene("mine", "here", "plain", Path("clip.mp4"), False, CONFIG),
        Scene("mine", "absent", "plain", Path("absent.mp4"), False, CONFIG),
        Scene("adt", "named", "adt", Path("results/adt/named/recording"), True, CONFIG, by_name=True),
    ]
    return {(row.dataset, row.scene): row for row in rows}


def words(stage: str, job: Job) -> dict[str, str]:
    """The flags of a stage's command, by name; repeated ones joined."""
    found = shlex.split(jobs.arguments(stage, job))
    flags = [*zip(found[::2], found[1::2], strict=True)]
    return {name[2:]: " ".join(value for flag, value in flags if flag == name) for name, _ in flags}


def test_a_run_without_a_target_takes_scenes_whose_recording_exists_or_can_be_made(scenes):
    assert [scene.name for scene in default_scenes(scenes.values())] == ["adt/one", "mine/here"]
    results = default_results(scenes["adt", "one"])
    assert "results/adt/one/metrics.json" in results and not [path for path in results if "variants" in path]


@pytest.mark.parametrize(
    "keys, moving, pages",
    [
        ({}, "refined", {"transient.png", "carries.png"}),
        ({"segments": {"track_moving": "never"}}, "refined", {"transient.png"}),
        ({"splats": {"masking": "refined"}}, "refined", {"carries.png"}),
        ({"splats": {"masking": "none"}, "segments": {"track_moving": "always"}}, "refined", set()),
        ({}, "none", set()),
    ],
)
def test_a_survey_that_finds_motion_adds_what_it_decides(scenes, monkeypatch, keys, moving, pages):
    scene = replace(scenes["mine", "here"], config=merge(CONFIG, keys))
    monkeypatch.setattr(Job, "survey", survey(moving))
    added = results_by_survey(Job(scene))
    assert added == [path for path in added if path not in default_results(scene)]
    assert {Path(path).name for path in added} == pages


def test_a_variant_reads_what_it_does_not_change_from_its_scene(scenes, monkeypatch):
    monkeypatch.setattr(Job, "survey", survey("none"))
    job, home = Job(scenes["mine", "here"], "v"), "results/mine/here"
    found = words("language", job)
    assert found["frames"] == f"{home}/frames.zarr" and found["splats"] == f"{home}/splats.zarr"
    assert found["features"] == f"{home}/variants/v/features.zarr"
    assert words("metrics", job)["title"] == "mine/here, v"
    assert words("metrics", Job(scenes["adt", "one"]))["world-seed"] == "0"


def test_the_survey_decides_what_splats_read(scenes, monkeypatch):
    job = Job(scenes["mine", "here"])
    monkeypatch.setattr(Job, "survey", survey("refined"))
    assert "masks" in words("splats", job) and json.loads(jobs.options("splats", job))["masking"] == "refined"
    monkeypatch.setattr(Job, "survey", survey("none"))
    assert "masks" not in words("splats", job)
    assert json.loads(jobs.options("splats", job))["refine_poses"] == "on"


def test_a_survey_is_waited_for_and_read_again_when_it_changes(scenes, monkeypatch):
    waited: list[str] = []
    monkeypatch.setattr(jobs, "read_document", lambda path, _: path.read_text())
    job = Job(scenes["mine", "here"], "v", wait=lambda scene, folder: waited.append(scene.name + folder))
    (path := Path("results/mine/here/survey.json")).parent.mkdir(parents=True)
    for number in range(2):
        path.write_text(f"{number}")
        os.utime(path, (number, number))
        assert job.survey == f"{number}"
    assert waited == ["mine/here"] * 2  # the variant shares it


def test_chunks_of_a_long_recording_are_gathered(scenes, monkeypatch):
    """A chunk gathers none, and leaves what moves to the job that gathers."""
    monkeypatch.setattr(Job, "survey", survey("refined", frames=1001))
    scene = scenes["mine", "here"]
    files = [f"results/mine/here/segments.{number}.chunk" for number in (1, 2, 3)]
    assert jobs.chunk_files("segments", Job(scene)) == files
    found, own = words("segments", Job(scene)), words("segments", Job(scene, chunk="2"))
    assert found["gather"] == " ".join(files) and "transient" in found
    assert own["chunk"] == "2" and not {"gather", "transient"} & {*own}


@pytest.mark.parametrize("stage", STAGES)
def test_a_parameter_of_each_stage_is_a_text(scenes, monkeypatch, stage):
    monkeypatch.setattr(Job, "survey", survey("refined"))
    for name, function in jobs.parameters(stage).items():
        assert isinstance(function(stage, Job(scenes["adt", "one"])), str), name


def test_a_missing_variant_or_file_of_gaussians_ends_the_plan(scenes):
    with pytest.raises(UserError, match="no variant 'w'"):
        jobs.path_of("frames", Job(scenes["mine", "here"], "w"))
    given = replace(scenes["mine", "here"], config=merge(CONFIG, {"splats": {"source": "none.ply"}}))
    with pytest.raises(UserError, match="none.ply"):
        jobs.arguments("frames", Job(given)) and jobs.options("frames", Job(given))

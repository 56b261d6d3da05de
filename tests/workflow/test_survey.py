"""The DAG follows the decisions of the survey; a rule reruns only if a decision that it uses changes."""

import re
import shutil
from pathlib import Path

import pytest

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, SEGMENTS, SPLATS
from egosplat.pipeline.validation import read_document

SCENE = "results/adt/scene1"
SURVEY, METRICS, TRANSIENT = f"{SCENE}/survey.json", f"{SCENE}/metrics.json", f"{SCENE}/transient.png"
AUTO = "splats: {masking: auto}\n"
STATIC = AUTO + "survey: {min_view_change_deg: 0, min_moving_share: 1.0}\n"
"""Whatever moves is little enough."""

LEAVING_OUT = AUTO + "survey: {min_view_change_deg: 90}\n"
STATIC_LEAVING_OUT = AUTO + "survey: {min_view_change_deg: %d, min_moving_share: 1.0}\n"
SPLATS_ON = {"splats", "language", "metrics"}


def made(workdir, config: str, *targets: str) -> set[str]:
    """Make targets with some more configuration; the names of the rules that ran."""
    (workdir.folder / "more.yaml").write_text(config)
    done = workdir.snakemake("more.yaml", "--", *targets)
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    return set(re.findall(r"^(?:local)?(?:rule|checkpoint) (\w+):", said, re.MULTILINE))


def edges(workdir, config: str, *targets: str) -> set[tuple[str, str]]:
    (workdir.folder / "more.yaml").write_text(config)
    return workdir.edges("more.yaml", "--rulegraph", "--", *targets)


@pytest.fixture(scope="module")
def surveyed(finished, tmp_path_factory):
    """A finished run with masks, surveyed afterwards, with its keys on auto. Not to be changed."""
    folder = tmp_path_factory.mktemp("surveyed") / "copy"
    copy = type(finished)(Path(shutil.copytree(finished.folder, folder, symlinks=True)))
    assert made(copy, AUTO, SURVEY) == {"survey"}
    return copy


@pytest.fixture
def work(surveyed, tmp_path):
    return type(surveyed)(Path(shutil.copytree(surveyed.folder, tmp_path / "copy", symlinks=True)))


def test_before_a_survey_that_chooses_frames_a_plan_shows_all_that_may_follow(workdir):
    for name in ("masks.zarr", "splats.zarr"):
        shutil.rmtree(workdir.folder / SCENE / name)
    (workdir.folder / METRICS).unlink()
    planned = workdir.stale(METRICS, config=AUTO)
    assert "survey" in planned and planned.isdisjoint({"transient", "masks"})
    assert workdir.stale(METRICS, config=LEAVING_OUT) >= {"survey", "masks", "splats"}


def test_an_unchanged_survey_decision_reruns_nothing(surveyed):
    assert read_document(surveyed.folder / SURVEY, "survey")["motion"]["masking"] == "refined"
    assert surveyed.stale(METRICS, TRANSIENT, config=AUTO) == set()


def test_the_survey_sees_frames_and_poses_alone(surveyed):
    pairs = edges(surveyed, AUTO, METRICS, SURVEY)
    assert {before for before, after in pairs if after == "survey"} == {"frames", "poses"}
    assert ("masks", "splats") in pairs and ("transient", "masks") in pairs


def test_a_static_scene_has_neither_network_nor_masks(work):
    assert made(work, STATIC, SURVEY) == {"survey"}
    assert work.stale(METRICS, config=STATIC) == SPLATS_ON
    pairs = edges(work, STATIC, METRICS)
    assert {"transient", "masks"}.isdisjoint({rule for pair in pairs for rule in pair})
    assert ("frames", "splats") in pairs


def test_a_static_scene_trains_gaussians_once(surveyed, work):
    """Masks of single frames are merged on those of splats; where something moves, splats follows the instances."""
    frames = "segments: {segmenter: sam2, prompting: each_frame}\n"
    assert made(work, STATIC, SURVEY) == {"survey"}
    for scene, config, on_splats in ((work, STATIC, True), (surveyed, AUTO, False)):
        pairs = edges(scene, config + frames, METRICS)
        assert (("splats", "instances") in pairs, ("masks", "splats") in pairs) == (on_splats, not on_splats)


def test_a_run_of_everything_draws_what_the_survey_finds_to_move(work):
    table = work.folder / "config/scenes.tsv"
    rows = table.read_text().splitlines(keepends=True)
    table.write_text("".join(row for row in rows if row.startswith(("dataset\t", "adt\tscene1\t"))))
    (work.folder / TRANSIENT).unlink()
    decided = {"transient_sheet", "histories", "carries_sheet"}
    tracks = "segments: {segmenter: sam2}\n"
    assert work.stale("all", config=AUTO) & decided == {"transient_sheet"}
    assert work.stale("all", config=AUTO + tracks) & decided == decided
    assert made(work, STATIC, SURVEY) == {"survey"}
    assert work.stale("all", config=STATIC + tracks) & decided == set()


@pytest.mark.slow
def test_a_survey_that_decides_the_same_again_reruns_nothing_else(work):
    assert made(work, STATIC, METRICS) >= {"survey", *SPLATS_ON}
    again = STATIC.replace("1.0}", "0.5}")
    assert "survey" in work.stale(METRICS, config=again)
    assert made(work, again, SURVEY) == {"survey"}
    assert work.stale(METRICS, config=again) == set()


@pytest.mark.slow
def test_redundant_frames_are_left_out_of_training(work):
    made(work, LEAVING_OUT, SURVEY)
    views = read_document(work.folder / SURVEY, "survey")["views"]
    assert views["left_out"]
    planned = work.stale(METRICS, config=LEAVING_OUT)
    assert planned == {"segments", "instances", "view_features", "features", "transient", "masks", *SPLATS_ON}
    assert made(work, LEAVING_OUT, f"{SCENE}/segments.zarr") == {"segments"}
    found = open_artifact(work.folder / SCENE / "segments.zarr", SEGMENTS)
    assert found.provenance["options"]["kept_frames"] == views["digest"]
    assert all((found.row("labels", frame) == -1).all() for frame in views["left_out"])
    assert work.stale(f"{SCENE}/segments.zarr", config=LEAVING_OUT) == set()


def test_a_static_scene_trains_gaussians_on_all_frames(work):
    splats, left_out = f"{SCENE}/splats.zarr", []
    for change_deg, rules in ((90, {"splats"}), (20, set())):
        config = STATIC_LEAVING_OUT % change_deg
        assert made(work, config, SURVEY) == {"survey"}
        left_out.append(read_document(work.folder / SURVEY, "survey")["views"]["left_out"])
        assert made(work, config, splats) == rules
    assert left_out[0] and left_out[0] != left_out[1]
    used = open_artifact(work.folder / splats, SPLATS).facts["views"]["training"]
    assert used == open_artifact(work.folder / SCENE / "frames.zarr", FRAMES).read("train").sum()


@pytest.mark.parametrize(
    "config, rules",
    [
        ("poses: {trajectory: ground_truth}\n", {"poses", "survey"}),
        ("survey: {min_view_change_deg: 0, min_moving_share: 1.0e-4}\n", {"survey"}),
        ("features: {supervision: average}\n", set()),
    ],
)
def test_a_changed_key_reruns_the_survey_where_it_reaches_it(surveyed, config, rules):
    assert surveyed.stale(SURVEY, config=AUTO + config) == rules


def test_edited_code_reruns_the_survey_where_it_executes_it(work):
    work.edit("moving_regions.py", "_MIN_TRACK = 3", "_MIN_TRACK = 2")
    assert work.stale(SURVEY, config=AUTO) == {"survey"}
    work.edit("segments/masks.py", "\ndef ", "\nCHANGED = 1\n\n\ndef ")
    assert made(work, AUTO, SURVEY) == {"survey"}
    assert work.stale(SURVEY, config=AUTO) == set()


def test_a_variant_whose_keys_reach_the_survey_has_its_own(work):
    variant = AUTO + "variants: {calm: {survey: {min_moving_share: 1.0}}}\n"
    own = f"{SCENE}/variants/calm"
    assert made(work, variant, f"{own}/survey.json") == {"survey"}
    assert read_document(work.folder / own / "survey.json", "survey")["motion"]["masking"] == "none"
    assert work.stale(f"{own}/metrics.json", config=variant) == SPLATS_ON
    assert work.stale(METRICS, config=variant) == set()

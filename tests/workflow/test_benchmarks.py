"""Benchmarks that read finished scenes run whole on a tiny one."""

import json
import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.colmap import __main__ as colmap
from benchmarks.figures import score_table
from benchmarks.misses.__main__ import CAUSES
from benchmarks.robustness import __main__ as robustness
from benchmarks.robustness.scene import ARTIFACTS, Scene
from benchmarks.rows import read_rows, stamp
from benchmarks.survey.__main__ import survey_of
from egosplat.artifacts.reader import open_any
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.errors import UserError
from egosplat.pipeline.home import title_of
from tests.support.tables import cells

pytestmark = pytest.mark.slow

NAME = "adt/scene1"


@pytest.fixture
def scene(finished) -> Path:
    """The finished scene."""
    return finished.folder / "results" / NAME


@pytest.fixture
def with_variant(scene, tmp_path):
    """Make a scene with a variant that has the scores and the Gaussians of the scene."""

    def make(*names: str) -> Path:
        folder = linked(scene, tmp_path / "results" / NAME)
        for name in names:
            variant = folder / "variants" / name
            variant.mkdir(parents=True)
            (variant / "splats.zarr").symlink_to(scene / "splats.zarr")
            (variant / "metrics.json").write_text(json.dumps(recorded(scene) | {"scene": title_of(variant)}))
        return folder

    return make


@pytest.fixture(scope="module")
def survey(finished, tmp_path_factory) -> dict:
    """The survey of the scene, which the tiny main job does without."""
    folder = linked(finished.folder / "results" / NAME, tmp_path_factory.mktemp("surveyed"))
    return survey_of(folder)


def linked(scene: Path, folder: Path) -> Path:
    """A folder with links to everything in a scene, to which files can be added."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in scene.iterdir():
        (folder / path.name).symlink_to(path)
    return folder


def run(name: str, *words: object) -> str:
    """What ``python -m benchmarks.NAME`` prints."""
    command = import_module(f"benchmarks.{name}").main
    done = CliRunner().invoke(command, [*map(str, words)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def by_column(text: str) -> list[dict[str, str]]:
    """The rows of the first table by its headings."""
    headings, *rows = cells(text)
    return [dict(zip(headings, row, strict=True)) for row in rows if len(row) == len(headings)]


def recorded(scene: Path) -> dict:
    """The scene's scores."""
    return json.loads((scene / "metrics.json").read_text())


def test_ablation(with_variant, tmp_path):
    variants = ("baseline", "no_masks", "network_masks")
    folder, kept = with_variant(*variants), tmp_path / "rows"
    flags = [word for name in variants for word in ("--variant", name)]
    said = run("ablation.__main__", folder, *flags, "--rows", kept)
    (row,) = [row for row in cells(said) if row[0] == "full against baseline"]
    assert row[1].startswith("0.0 (")
    rows = read_rows(kept)
    assert rows.settings == ["full", *variants]
    assert score_table(rows) in said and stamp(rows.about) in said
    found = recorded(folder)
    assert len(rows.of("queries", "full", group="all")) == found["scores"]["all"]["count"]
    assert rows.of("frames", "full", group="all")["psnr"].mean() == pytest.approx(
        found["rendering"]["all"]["psnr"], abs=1e-3
    )
    assert len(rows.of("presence", "full")) == len(found["presence"]["queries"])
    assert sum(path.stat().st_size for path in kept.iterdir()) < 100_000


def test_colmap(scene, monkeypatch):
    (row,) = by_column(run("colmap.__main__", scene))
    assert (row["scene"], row["frames"], row["size"]) == (NAME, "12", "96x96")

    def fail(*_: object) -> None:
        raise UserError("no pair of frames matches")

    monkeypatch.setattr(colmap, "run", fail)
    assert "no pair of frames matches" in run("colmap.__main__", scene)


def test_corrections(with_variant):
    rows = by_column(run("corrections.__main__", with_variant("corrected")))
    assert [row["corrections"] for row in rows] == ["off", "on"]
    assert rows[0]["PSNR"] == rows[1]["PSNR"] and rows[0]["brighter"] == "+0.00"
    assert rows[0]["pose error"] == "0.0 mm, 0.00°"


def test_instances(scene):
    words = ("--iterations", 20, "--change", "defaults", "--change", "no merging")
    rows = by_column(run("instances.__main__", scene, *words))
    assert [row["change"] for row in rows] == ["segments.zarr", "defaults", "no merging"]
    count = [int(row["instances"]) for row in rows]
    assert 0 < count[1] < count[2]


def test_presence(scene, tmp_path):
    other = tmp_path / "results" / "adt" / "other"
    other.mkdir(parents=True)
    (other / "metrics.json").write_text(json.dumps(recorded(scene) | {"scene": "adt/other"}))
    said = run("presence.__main__", scene, other, "--rows", tmp_path / "rows")
    queries = recorded(scene)["presence"]["queries"]
    judged = [a for a in queries if a["evidence"] and (not a["present"] or a["right"] is not None)]
    counts = [int(row[1]) for row in cells(said) if " to " in row[0]]
    assert sum(counts) == 2 * sum(not a["untaught"] for a in judged) and "log loss" in said
    assert len(read_rows(tmp_path / "rows").of("presence", "full")) == 2 * len(queries)


def test_misses(scene):
    said = run("misses.__main__", scene, "--each")
    missed = [
        one
        for one in recorded(scene)["queries"]
        if "all" in one["groups"] and not one["groups"]["all"]["hit"]
    ]
    (row,) = [row for row in cells(said) if row[0] == NAME and row[3] not in CAUSES]
    assert [int(row[2]), sum(map(int, row[3:]))] == [len(missed)] * 2
    assert {(row[1], row[2]) for row in cells(said) if row[0] == NAME and row[3] in CAUSES} == {
        (str(one["frame"]), one["category"]) for one in missed
    }


def test_still_masks(with_variant, survey):
    folder = with_variant()
    (folder / "survey.json").write_text(json.dumps(survey))
    (row,) = by_column(run("real_camera.still_masks", folder))
    assert row["share that moves"] == f"{survey['motion']['share']:.3%}"
    assert re.fullmatch(r"\d+ of \d+", row["instances masked"]) and 0 < float(row["pixels masked"][:-1]) < 100


def test_required(with_variant, survey):
    folder = with_variant("anyway")
    (folder / "survey.json").write_text(json.dumps(survey))
    (row,) = by_column(run("required.__main__", folder))
    assert row["frames left out"] == f"{len(survey['views']['left_out'])} of 12"
    assert row["scene"] == NAME and row["static PSNR"] == row["anyway's"]
    assert int(row["CPU-s"]) >= int(row["anyway"])  # the survey besides


def test_robustness(finished, tmp_path, monkeypatch):
    """What is killed and counted. tests/workflow/test_interruption.py kills; here it would take minutes."""
    killed = []

    def kill(scene: Scene, folder: Path, stage: str, victim: str, share: float) -> dict[str, object]:
        again = scene.copy(folder)
        again.lose(stage)
        killed.append((stage, victim, scene.there() - again.there()))
        return {"resumed": victim == "stage", "s to the end": 2.0}

    monkeypatch.setattr(robustness, "finished_scene", lambda _: Scene(finished.folder))
    monkeypatch.setattr(robustness, "kill", kill)
    said = CliRunner().invoke(robustness.main, ["kills", "--stage", "features"], catch_exceptions=False)
    lost = {"features", "language", "metrics"}
    assert killed == [("features", victim, lost) for victim in ("stage", "stage", "Snakemake")]
    row, _ = by_column(said.stdout)
    assert (row["times"], row["resumed"], row["s to the end"]) == ("3", "2", "2")


def test_robustness_plans_its_scene(tmp_path):
    scene = Scene(tmp_path / "small")
    scene.folder.mkdir()
    scene.prepare()
    assert scene.start("--dry-run").wait() == 0, scene.said()
    planned = set(re.findall(r"^(?:rule|checkpoint) (\w+):", scene.said(), re.MULTILINE))
    assert {"synthetic", "survey", "segments", "features", "metrics"} <= planned <= set(ARTIFACTS)


def test_survey(scene, survey, tmp_path, monkeypatch):
    monkeypatch.setattr(import_module("benchmarks.survey.__main__"), "ROWS", tmp_path / "rows.csv")
    (folder := tmp_path / "results/adt/busy1").mkdir(parents=True)
    (folder / "frames.zarr").symlink_to(scene / "frames.zarr")
    (folder / "survey.json").write_text(json.dumps(survey))
    rows = cells(run("survey.__main__", folder))
    assert [(row[0], row[1], row[-1]) for row in rows if row[0] == "busy"] == [("busy", "people", "0/1")]


def test_transient(scene):
    rows = by_column(run("transient.__main__", scene))
    kinds = {row["masks"]: row for row in rows if row["scene"] == "all"}
    assert set(kinds) == {"network alone", "true instances", "instances.zarr"}
    assert 0 <= float(kinds["network alone"]["IoU"]) <= 1


def test_true_instances(scene):
    said = run("true_instances.__main__", scene)
    rows = by_column(said)
    assert [row["setting"] for row in rows] == ["view", "inliers"]
    assert {row["queries"] for row in rows} == {str(recorded(scene)["scores"]["all"]["count"])}


def test_every_frame_of_the_growth_shows_masks_of_its_cells(scene, tmp_path):
    run("growth.masks", scene, tmp_path / "cells", 4)
    segments = open_any(tmp_path / "cells" / "segments.zarr", SCHEMAS)
    first, level = segments.read("instances/first_frame"), segments.read("instances/level")
    assert 1 <= np.bincount(first).max() <= 4
    assert (level == 2).all()
    for frame in range(segments.shape("labels")[0]):
        assert set(np.unique(segments.row("labels", frame))) - {-1} == set(np.flatnonzero(first == frame))

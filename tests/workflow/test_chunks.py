"""A long recording on one machine: a job for each chunk of its frames, and only what was lost is done again."""

import re

import pytest

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import SPLATS as SPLATS_SCHEMA

SCENE = "results/adt/scene1"
SURVEY, VIEWS = f"{SCENE}/survey.json", f"{SCENE}/view_features.zarr"
AUTO = "splats: {masking: auto}\n"
SPLATS = f"{SCENE}/splats.zarr"
CELLS = "splats: {masking: none}\nsurvey: {cell_views: 5, min_view_change_deg: 0.1}\n"

ENDS = """        if batches and 4 <= batches[0].frame[0] < 8 and not Path("again").exists():
            raise SystemExit(1)
"""
CELL_ENDS = """    if chunk == 2 and not Path("again").exists():
        raise SystemExit(1)
"""
"""The job of the second chunk ends without a result."""


def made(workdir, *words: str) -> list[str]:
    """Run Snakemake; the names of the rules that ran, sorted."""
    done = workdir.snakemake("more.yaml", *words)
    return sorted(
        re.findall(r"^(?:local)?(?:rule|checkpoint) (\w+):", done.stdout + done.stderr, re.MULTILINE)
    )


@pytest.mark.slow
def test_only_a_long_recording_has_chunks_and_a_lost_one_alone_is_done_again(workdir):
    folder = workdir.folder
    (folder / "more.yaml").write_text(AUTO)
    assert made(workdir, "--", SURVEY) == ["survey"]
    assert workdir.stale(VIEWS, config=AUTO) == set()

    workdir.edit("pipeline/chunks.py", "CHUNK_FRAMES = 500", "CHUNK_FRAMES = 4")
    before = "        views, wanted = join_views(batches)"
    workdir.edit("features/view_features_stage.py", before, ENDS + before)
    (folder / "more.yaml").write_text(AUTO)
    ran = made(workdir, "--keep-going", "--", VIEWS)
    assert ran == ["instances", "segments", *3 * ["view_features_chunk"]]
    assert {path.name for path in (folder / SCENE).glob("*.chunk")} == {
        "view_features.1.chunk",
        "view_features.3.chunk",
    }

    (folder / "again").touch()
    assert made(workdir, "--", VIEWS) == ["view_features", "view_features_chunk"]
    assert not [*(folder / SCENE).glob("*.chunk")]
    assert workdir.stale(VIEWS, config=AUTO) == set()


@pytest.mark.slow
def test_a_large_scene_trains_in_cells_and_a_lost_one_alone_is_done_again(workdir):
    folder = workdir.folder
    workdir.edit("survey/cells.py", "sides[axis] <= least", "sides[axis] <= 0.0")
    workdir.edit("splats/stage.py", "    state = begin(", CELL_ENDS + "    state = begin(")
    (folder / "more.yaml").write_text(CELLS)
    assert made(workdir, "--", SURVEY) == ["survey"]
    assert made(workdir, "--keep-going", "--", SPLATS) == 2 * ["splats_chunk"]
    (folder / "again").touch()
    assert made(workdir, "--", SPLATS) == ["splats", "splats_chunk"]
    assert "cells" in open_artifact(folder / SPLATS, SPLATS_SCHEMA).provenance["options"]
    assert not [*(folder / SCENE).glob("*.chunk")] and workdir.stale(SPLATS, config=CELLS) == set()
    assert workdir.stale(SPLATS, config=CELLS.replace("5", "3")) == {"survey", "splats"}

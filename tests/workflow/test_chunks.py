"""A long recording on one machine: a job for each chunk of its frames, and only what was lost is done again."""

import re

import pytest

SCENE = "results/adt/scene1"
SURVEY, VIEWS = f"{SCENE}/survey.json", f"{SCENE}/view_features.zarr"
AUTO = "splats: {masking: auto}\n"

ENDS = """        if batches and 4 <= batches[0].frame[0] < 8 and not Path("again").exists():
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

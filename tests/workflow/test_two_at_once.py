"""Two Snakemakes in one working directory: the second stops with a message, and no output is harmed."""

from pathlib import Path

import pytest

from benchmarks.robustness.scene import remove
from egosplat.artifacts.lineage import check_tree

ROOT = Path(__file__).parents[2]
SCENE = Path("results/adt/scene1")


@pytest.mark.slow
def test_two_concurrent_runs_do_the_work_once(workdir, tmp_path):
    target = SCENE / "transient.png"
    remove(workdir.folder / SCENE / "transient.zarr")
    remove(workdir.folder / target)
    transcripts = [tmp_path / "first.txt", tmp_path / "second.txt"]
    both = [workdir.start("--cores", "1", "--", target, transcript=said) for said in transcripts]
    statuses = [process.wait(timeout=600) for process in both]
    assert 0 in statuses, [said.read_text() for said in transcripts]
    for status, said in zip(statuses, transcripts, strict=True):
        text = said.read_text()
        assert "Traceback" not in text
        assert "no other Snakemake process" in text if status else "Error" not in text
    assert not any(check_tree(workdir.folder / "results", lambda _: None).values())
    assert not workdir.stale(str(target))

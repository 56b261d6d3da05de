"""Killed in the middle of a write, or run twice at once: nothing looks whole, and the next run makes it."""

import os
import shutil
import signal
import subprocess
from pathlib import Path

import psutil
import pytest

from benchmarks.robustness.scene import remove
from egosplat.artifacts.lineage import check_tree
from tests.support.waiting import wait_for

pytestmark = pytest.mark.slow

SCENE = Path("results/adt/scene1")
RECORDING = SCENE / "recording"


def half_written(workdir) -> list[Path]:
    return list((workdir.folder / SCENE).glob(".recording.*.tmp/.video.vrs.*.tmp"))


def writers(workdir) -> list[psutil.Process]:
    """The stage's process that runs in the working directory, not the shell around it."""
    found = []
    for process in psutil.process_iter(["cmdline", "cwd"]):
        words = process.info["cmdline"] or []
        if "synthetic" in words and process.info["cwd"] == str(workdir.folder.resolve()):
            found.append(process)
    return found


def begun(workdir) -> "subprocess.Popen[bytes]":
    """Snakemake, as a terminal has it, while it makes the recording anew."""
    shutil.rmtree(workdir.folder / RECORDING)
    # What a shell starts in the background ignores interrupts, and so do its children; on a terminal none does.
    before = ("env", "--default-signal=INT")
    process = workdir.start("--", RECORDING, transcript=workdir.folder / "said.txt", before=before)
    wait_for(lambda: half_written(workdir))
    return process


def check_recording_is_made(workdir) -> str:
    """Make the recording, of which nothing is there, with nothing left half-written; what is said of it."""
    assert not (workdir.folder / RECORDING).exists()
    said = workdir.run(str(RECORDING))
    assert (workdir.folder / RECORDING / "video.vrs").exists()
    assert not [path for path in (workdir.folder / SCENE).iterdir() if path.name.endswith(".tmp")]
    return said


@pytest.mark.parametrize("how", ["the stage is killed", "Snakemake is interrupted"])
def test_an_interrupted_stage_leaves_no_partial_artifact(workdir, how):
    process = begun(workdir)
    if how == "the stage is killed":
        stages = writers(workdir)
        assert stages
        for stage in stages:
            stage.kill()
    else:
        os.killpg(process.pid, signal.SIGINT)  # as Ctrl-C on a terminal does
    assert process.wait(timeout=300) != 0
    told = "most likely for lack of memory" in (workdir.folder / "said.txt").read_text()
    assert told == (how == "the stage is killed")
    check_recording_is_made(workdir)
    assert not any(check_tree(workdir.folder / "results", lambda _: None).values())


def test_after_a_killed_snakemake_the_same_command_goes_on(workdir):
    """Its stage ends with it, and nobody has to unlock."""
    process = begun(workdir)
    assert writers(workdir)
    process.kill()
    process.wait()
    assert any((workdir.folder / ".snakemake/locks").iterdir()), "a killed Snakemake leaves its locks"
    wait_for(lambda: not writers(workdir))
    assert "was killed: continuing" in check_recording_is_made(workdir)


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

"""Locks of a killed Snakemake are removed, those of a running one stay; a stage ends with its Snakemake; a user has a name."""

import getpass
import os
import subprocess
import sys
import time
from pathlib import Path

from egosplat.pipeline.process_guards import STARTED_BY, clear_stale_locks, name_user

HOLD = """
import sys
import time
from pathlib import Path
from egosplat.pipeline.process_guards import clear_stale_locks
print(clear_stale_locks(Path(sys.argv[1])), flush=True)
sys.stdin.read()
"""


def started(*words: object, **environment: str) -> subprocess.Popen[str]:
    """A process of Python that has said a line, and lives on."""
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    command = [sys.executable, "-c", *map(str, words)]
    process = subprocess.Popen(command, env=os.environ | environment, text=True, **pipes)
    process.said = process.stdout.readline().strip()
    return process


def another(folder: Path) -> subprocess.Popen[str]:
    """A process that has looked at the folder."""
    return started(HOLD, folder)


def locked(folder: Path) -> Path:
    lock = folder / "locks/0.output.lock"
    lock.parent.mkdir(parents=True, exist_ok=True)
    lock.write_text("results/x\n")
    return lock


def test_locks_of_killed_snakemakes_are_removed_and_stay_while_one_runs(tmp_path):
    lock = locked(tmp_path)
    first = another(tmp_path)
    assert first.said == "True" and not lock.exists()
    locked(tmp_path)
    second, third = another(tmp_path), another(tmp_path)
    assert second.said == third.said == "False" and lock.exists()
    first.communicate("")
    assert another(tmp_path).communicate("")[0] == "" and lock.exists(), "two others are alive still"
    for process in (second, third):
        process.kill()
        process.wait()
    last = another(tmp_path)
    assert last.said == "True" and not lock.exists()
    last.communicate("")


def test_an_unreadable_lock_folder_is_left_to_snakemake(tmp_path):
    (tmp_path / "file").write_text("")
    assert clear_stale_locks(tmp_path / "file") is False
    assert clear_stale_locks(tmp_path / "missing" / "deeper") is False


def test_locks_stay_while_jobs_of_the_folder_are_queued(tmp_path, monkeypatch):
    """Jobs outlive a killed Snakemake; two must not write one artifact."""
    lock, queue = locked(tmp_path / "work/.snakemake"), tmp_path / "squeue"
    queue.write_text(f"#!/bin/sh\necho {tmp_path / 'work'}\n")
    queue.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    assert not clear_stale_locks(tmp_path / "work/.snakemake") and lock.exists()


def test_a_user_without_a_name_gets_a_number(monkeypatch):

    def unknown() -> str:
        raise KeyError("getpwuid(): uid not found")

    monkeypatch.setenv("USER", "me")
    name_user()
    assert os.environ["USER"] == "me"
    monkeypatch.setattr(getpass, "getuser", unknown)
    name_user()
    assert os.environ["USER"] == str(os.getuid())


STAGE = """
import time
from egosplat.pipeline.process_guards import end_with_snakemake
from egosplat.progress import show_log
show_log()
end_with_snakemake()
print("begun", flush=True)
time.sleep(600)
"""


def stage(started_by: str) -> subprocess.Popen[str]:
    process = started(STAGE, **{STARTED_BY: started_by})
    assert process.said == "begun"
    return process


def test_a_stage_exits_with_its_snakemake():
    snakemake = subprocess.Popen(["sleep", "600"])
    process = stage(str(snakemake.pid))
    time.sleep(0.2)
    assert process.poll() is None
    snakemake.kill()
    snakemake.wait()
    assert process.wait(timeout=120) == 1
    assert "continues from here" in process.stderr.read()


def test_a_stage_without_snakemake_keeps_running():
    processes = [stage(started_by) for started_by in ("", "rubbish", str(os.getpid()))]
    time.sleep(1.5)
    for process in processes:
        assert process.poll() is None
        process.kill()
        process.wait()

"""Time and memory in each artifact's provenance: the tables and docs/running.md report them."""

import subprocess
import sys
import threading
import types

from egosplat.artifacts import provenance
from egosplat.artifacts.provenance import begin, key_of

WORK_S = 0.1
"""Processor time that each thread and child uses."""

WORK = f"""
import time
while time.thread_time() < {WORK_S}:
    pass
"""


def test_time_of_threads_and_children_counts():
    start = provenance.cpu_seconds()
    thread = threading.Thread(target=exec, args=(WORK,))
    thread.start()
    thread.join()
    after_thread = provenance.cpu_seconds()
    subprocess.run([sys.executable, "-c", WORK], check=True)
    assert after_thread - start >= WORK_S
    assert provenance.cpu_seconds() - after_thread >= WORK_S


def test_memory_grows_by_what_is_held():
    code = (
        "from egosplat.artifacts import provenance; before = provenance.peak_memory_mb(); held = b'x' * (100 * 2**20);"
        "print(provenance.peak_memory_mb() - before)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert 90 < float(done.stdout) < 120


def test_a_gpu_counts_where_it_was_used(monkeypatch):
    """Memory of all GPUs is summed; a process without PyTorch has none."""
    monkeypatch.setitem(sys.modules, "torch", None)
    assert provenance.peak_gpu_memory_mb() is None and "core" in provenance.machine()
    cuda = types.SimpleNamespace(
        is_initialized=lambda: True,
        device_count=lambda: 2,
        max_memory_allocated=lambda index: (index + 1) * 2**20,
        get_device_name=lambda: "a GPU",
    )
    monkeypatch.setitem(sys.modules, "torch", types.SimpleNamespace(cuda=cuda))
    assert provenance.peak_gpu_memory_mb() == 3.0 and provenance.machine().endswith(", a GPU")


def test_the_commit_is_that_of_tracked_files_alone(tmp_path):
    """An installation inside somebody's repository has no commit; a file besides makes a checkout unclean."""

    def git(*words: str) -> str:
        own = ("-c", "user.name=x", "-c", "user.email=x@x")
        return subprocess.check_output(["git", *own, *words], cwd=tmp_path, text=True).strip()

    def checkout(folder: str) -> dict:
        return provenance.checkout.__wrapped__(tmp_path / folder)

    nothing = {"commit": None, "clean": None}
    for folder in ("src", "installed"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "code.py").write_text("")
    assert checkout("src") == nothing
    git("init", "--quiet")
    git("add", "src")
    git("commit", "--quiet", "--message", "first")
    assert checkout("installed") == nothing
    assert checkout("src") == {"commit": git("rev-parse", "HEAD"), "clean": False}
    (tmp_path / ".git" / "info" / "exclude").write_text("installed")
    assert checkout("src")["clean"] is True
    (tmp_path / "src" / "code.py").write_text("changed")
    assert checkout("src")["clean"] is False


def test_a_commit_is_recorded_and_decides_nothing(monkeypatch):
    found = []
    for commit in ("c0de", "beef"):
        monkeypatch.setattr(provenance, "checkout", lambda commit=commit: {"commit": commit, "clean": True})
        made = begin("survey", {}, "synthetic")
        found.append((made.record()["commit"], made.code, key_of(made)))
    assert [commit for commit, _, _ in found] == ["c0de", "beef"] and found[0][1:] == found[1][1:]

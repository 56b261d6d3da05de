"""What a process has taken."""

import subprocess
import sys
import threading
import types

import numpy as np

from egosplat import costs


def work() -> None:
    for _ in range(20):
        np.random.default_rng(0).random(500_000).sort()


def test_time_of_threads_and_children_counts():
    start = costs.cpu_seconds()
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    after_thread = costs.cpu_seconds()
    subprocess.run([sys.executable, "-c", "sum(range(3_000_000))"], check=True)
    assert after_thread - start > 0.05
    assert costs.cpu_seconds() - after_thread > 0.02


def test_memory_grows_by_what_is_held():
    code = (
        "from egosplat import costs; before = costs.peak_memory_mb(); held = b'x' * (100 * 2**20);"
        "print(costs.peak_memory_mb() - before)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert 90 < float(done.stdout) < 120


def test_a_gpu_counts_where_it_was_used(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    assert costs.peak_gpu_memory_mb() is None and "core" in costs.machine()
    cuda = types.SimpleNamespace(
        is_initialized=lambda: True,
        device_count=lambda: 2,
        max_memory_allocated=lambda index: (index + 1) * 2**20,
        get_device_name=lambda: "a GPU",
    )
    monkeypatch.setitem(sys.modules, "torch", types.SimpleNamespace(cuda=cuda))
    assert costs.peak_gpu_memory_mb() == 3.0 and costs.machine().endswith(", a GPU")


def test_a_processor_without_a_name_is_told_by_its_kind(tmp_path):
    assert costs._processor(tmp_path / "absent")
    (tmp_path / "cpuinfo").write_text("processor\t: 0\nmodel name\t: Some CPU\n")
    assert costs._processor(tmp_path / "cpuinfo") == "Some CPU"

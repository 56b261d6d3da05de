"""Processor time and memory that a process has used, the machine that it runs on, and the commit of its code."""

import functools
import os
import platform
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

_KIB, _MIB = 2**10, 2**20


def cpu_seconds() -> float:
    """Processor time of all threads of this process and of its finished child processes [s]."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def peak_memory_mb() -> float:
    """Peak main memory of this process [MiB]."""
    # On Linux, getrusage starts from the peak of the parent process; VmHWM does not.
    lines = Path("/proc/self/status").read_text().splitlines()
    peaks = (int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))
    return next(peaks, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / _KIB


def peak_gpu_memory_mb() -> float | None:
    """Peak memory of PyTorch on its GPUs [MiB]; None if it used none."""
    cuda = _used_cuda()
    if cuda is None:
        return None
    return sum(cuda.max_memory_allocated(index) for index in range(cuda.device_count())) / _MIB


def machine() -> str:
    """The processor, the cores that this process may use, and the GPU that PyTorch used, as one line."""
    cores = len(os.sched_getaffinity(0))
    cuda = _used_cuda()
    gpu = "" if cuda is None else f", {cuda.get_device_name()}"
    return f"{_processor()}, {cores} core{'s' if cores > 1 else ''}{gpu}"


@functools.cache
def checkout(folder: Path = Path(__file__).parent) -> dict[str, Any]:
    """The commit of the code in a folder, and whether the checkout is clean: as committed, and nothing added.

    Both are None outside a checkout, or without git.
    """
    # An environment inside another repository is no checkout of egosplat: that repository does not track these files.
    if not _git(folder, "ls-files"):
        return {"commit": None, "clean": None}
    return {"commit": _git(folder, "rev-parse", "HEAD"), "clean": _git(folder, "status", "--porcelain") == ""}


def _git(folder: Path, *words: str) -> str | None:
    """What git says of a folder; None if it cannot."""
    try:
        done = subprocess.run(["git", *words], check=False, cwd=folder, capture_output=True, text=True)
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def _used_cuda() -> Any:
    """``torch.cuda`` if this process has used it, else None."""
    # Importing PyTorch here would take seconds in a stage that does not use it.
    torch = sys.modules.get("torch")
    return torch.cuda if torch is not None and torch.cuda.is_initialized() else None


@functools.cache
def _processor() -> str:
    """Name of the processor, or its architecture if the name is unknown."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())

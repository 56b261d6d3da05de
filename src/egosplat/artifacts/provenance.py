"""Provenance of artifacts: how each was made, by which code, on which machine, in how much time and memory."""

import functools
import hashlib
import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import egosplat
from egosplat.artifacts.reader import Artifact
from egosplat.pipeline.code_hash import library_version
from egosplat.pipeline.home import SETTINGS
from egosplat.pipeline.process_guards import STARTED_BY
from egosplat.pipeline.stages import STAGES, code_of

# Attributes of ``Provenance`` of which only ``cost`` tells.
_CLOCKS = ("started", "started_cpu", "gathered")


@dataclass(frozen=True)
class Provenance:
    """How an artifact is made, by which ``options``; ``origin`` is ``synthetic`` if any input is, else ``real``.

    Attributes:
        inputs, models: digest of each input by file name, and hash of each model by the key of its checkpoint.
        code: content hash of the code that the stage executes.
        created: UTC time at the start of the stage.
        started, started_cpu: monotonic clock, and processor time of the process, at the start [s].
        gathered: costs of the jobs whose results the stage gathers.
    """

    stage: str
    options: Mapping[str, Any]
    origin: str
    inputs: Mapping[str, str]
    models: Mapping[str, str]
    code: str
    versions: Mapping[str, str]
    created: str
    started: float
    started_cpu: float
    gathered: Sequence[Mapping[str, float | None]] = ()

    def record(self) -> dict[str, Any]:
        """Plain JSON values, with the machine, the commit, times and peak memory as of now."""
        values = {key: value for key, value in asdict(self).items() if key not in _CLOCKS}
        about = {"machine": machine(), "settings": os.environ.get(SETTINGS, "")}
        return values | about | checkout() | self.cost()

    def cost(self) -> dict[str, float | None]:
        """Time and peak memory as of now, with those of gathered jobs."""
        now = {
            "wall_s": time.perf_counter() - self.started,
            "cpu_s": cpu_seconds() - self.started_cpu,
            "peak_memory_mb": peak_memory_mb(),
            "peak_gpu_memory_mb": peak_gpu_memory_mb(),
        }
        joined: dict[str, float | None] = {}
        for name in now:
            values = [job[name] for job in (now, *self.gathered)]
            known = [value for value in values if value is not None]
            joined[name] = round((max if name.startswith("peak") else sum)(known), 3) if known else None
        return joined


def key_of(made: Provenance, more: Mapping[str, Any] | None = None) -> str:
    """SHA-256 of all that decides the result: stage, options, inputs, models, code, versions, and ``more``."""
    # Without times, the machine and the commit, which do not change the result.
    mappings = (made.options, made.inputs, made.models, made.versions, more or {})
    parts = [made.stage, made.code, *map(dict, mappings)]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def joint_origin(artifacts: Iterable[Artifact]) -> str:
    """``synthetic`` if one of the artifacts is, else ``real``."""
    return "synthetic" if any(artifact.origin == "synthetic" for artifact in artifacts) else "real"


def begin(
    stage: str,
    options: Mapping[str, Any],
    origin: str,
    inputs: Mapping[str, str] | None = None,
    models: Mapping[str, str] | None = None,
    chosen: str | None = None,
) -> Provenance:
    """Start a ``Provenance`` and its clocks; ``chosen`` is the value by which the stage chooses its module, if any."""
    versions = {"egosplat": egosplat.__version__, "python": sys.version.split()[0]}
    return Provenance(
        stage=stage,
        options=dict(sorted(options.items())),
        origin=origin,
        inputs=dict(sorted((inputs or {}).items())),
        models=dict(sorted((models or {}).items())),
        code=code_of(stage, chosen),
        versions=versions | {name: library_version(name) for name in STAGES[stage].libraries},
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        started=time.perf_counter(),
        # A process that Snakemake started does nothing else: its imports count.
        started_cpu=0.0 if STARTED_BY in os.environ else cpu_seconds(),
    )


def begin_from(
    stage: str,
    options: Mapping[str, Any],
    used: Iterable[Artifact],
    models: Mapping[str, str] | None = None,
    chosen: str | None = None,
) -> Provenance:
    """Start the provenance of an artifact whose inputs are the artifacts ``used``; otherwise as ``begin``."""
    used = list(used)
    inputs = {artifact.path.name: artifact.digest for artifact in used}
    return begin(stage, options, joint_origin(used), inputs, models, chosen)


def cpu_seconds() -> float:
    """Processor time of all threads of this process and of its finished child processes [s]."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def peak_memory_mb() -> float:
    """Peak main memory of this process [MiB]."""
    # On Linux, getrusage starts from the peak of the parent process; VmHWM does not.
    peak = _first_value(Path("/proc/self/status"), "VmHWM")
    return float(peak.split()[0] if peak else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 2**10


def peak_gpu_memory_mb() -> float | None:
    """Peak memory of PyTorch on its GPUs [MiB]; None if it used none."""
    if (cuda := _used_cuda()) is None:
        return None
    return sum(cuda.max_memory_allocated(index) for index in range(cuda.device_count())) / 2**20


def machine() -> str:
    """The processor, the cores that this process may use, and the GPU that PyTorch used, as one line."""
    processor = _first_value(Path("/proc/cpuinfo"), "model name") or platform.machine()
    cores, cuda = len(os.sched_getaffinity(0)), _used_cuda()
    gpu = "" if cuda is None else f", {cuda.get_device_name()}"
    return f"{processor}, {cores} core{'s' if cores > 1 else ''}{gpu}"


@functools.cache
def checkout(folder: Path = Path(__file__).parent) -> dict[str, Any]:
    """The commit of the code in a folder, and whether all is as committed; both None outside a checkout or without git."""
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
    # An import would take seconds in a stage that does not use it.
    torch = sys.modules.get("torch")
    return torch.cuda if torch is not None and torch.cuda.is_initialized() else None


def _first_value(file: Path, key: str) -> str:
    """What the first line with a key says in a file of the kernel; empty if none has it."""
    lines = (line.partition(":") for line in file.read_text().splitlines())
    return next((value.strip() for name, _, value in lines if name.strip() == key), "")

"""Provenance of artifacts: recorded by each stage, and shown in the tables."""

import hashlib
import json
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import egosplat
from egosplat.artifacts import usage
from egosplat.pipeline.code_hash import library_version
from egosplat.pipeline.stages import STAGES, code_of

if TYPE_CHECKING:
    from egosplat.artifacts.reader import Artifact

# Attributes of ``Provenance`` of which only ``cost`` tells.
_CLOCKS = ("started", "started_cpu", "gathered")


@dataclass(frozen=True)
class Provenance:
    """How an artifact is made.

    Attributes:
        options: its configuration keys with their values.
        origin: ``synthetic`` if any input is synthetic, else ``real``.
        inputs: digest of each input artifact, by file name.
        models: hash of each model, by the configuration key of its checkpoint.
        code: content hash of the code that the stage executes.
        versions: versions of egosplat, Python and the libraries of the stage.
        created: UTC time at the start of the stage.
        started: time on the monotonic clock at the start [s].
        started_cpu: processor time that the process had used at the start [s].
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
        return values | {"machine": usage.machine()} | usage.checkout() | self.cost()

    def cost(self) -> dict[str, float | None]:
        """Time and peak memory as of now, with those of gathered jobs."""
        now = {
            "wall_s": time.perf_counter() - self.started,
            "cpu_s": usage.cpu_seconds() - self.started_cpu,
            "peak_memory_mb": usage.peak_memory_mb(),
            "peak_gpu_memory_mb": usage.peak_gpu_memory_mb(),
        }
        jobs = [now, *self.gathered]
        known = {name: [job[name] for job in jobs if job[name] is not None] for name in now}
        joined = {name: max if name.startswith("peak") else sum for name in now}
        return {name: round(joined[name](few), 3) if few else None for name, few in known.items()}


def key_of(made: Provenance, more: Mapping[str, Any] | None = None) -> str:
    """SHA-256 of all that decides the result: stage, options, inputs, models, code, versions, and ``more``."""
    # Without times, the machine and the commit, which do not change the result.
    mappings = (made.options, made.inputs, made.models, made.versions, more or {})
    parts = [made.stage, made.code, *map(dict, mappings)]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def joint_origin(*origins: str) -> str:
    """``synthetic`` if one of the origins is, else ``real``."""
    return "synthetic" if "synthetic" in origins else "real"


def begin(
    stage: str,
    options: Mapping[str, Any],
    origin: str,
    inputs: Mapping[str, str] | None = None,
    models: Mapping[str, str] | None = None,
    chosen: str | None = None,
) -> Provenance:
    """Start the provenance of an artifact, and its clocks; arguments as the attributes of ``Provenance``.

    Args:
        chosen: the value by which the stage chooses its module, if it chooses one.
    """
    versions = {"egosplat": egosplat.__version__, "python": sys.version.split()[0]}
    versions |= {name: library_version(name) for name in STAGES[stage].libraries}
    return Provenance(
        stage=stage,
        options=dict(sorted(options.items())),
        origin=origin,
        inputs=dict(sorted((inputs or {}).items())),
        models=dict(sorted((models or {}).items())),
        code=code_of(stage, chosen),
        versions=versions,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        started=time.perf_counter(),
        started_cpu=usage.cpu_seconds(),
    )


def begin_from(
    stage: str,
    options: Mapping[str, Any],
    used: "Iterable[Artifact]",
    models: Mapping[str, str] | None = None,
    chosen: str | None = None,
) -> Provenance:
    """Start the provenance of an artifact whose inputs are the artifacts ``used``; otherwise as ``begin``."""
    used = list(used)
    origin = joint_origin(*(artifact.origin for artifact in used))
    inputs = {artifact.path.name: artifact.digest for artifact in used}
    return begin(stage, options, origin, inputs, models, chosen)

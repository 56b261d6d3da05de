"""How an artifact was made: what travels with it down to the tables."""

import resource
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib import metadata
from typing import Any

import egosplat
from egosplat.stages import STAGES, code_of


@dataclass(frozen=True)
class Provenance:
    """How an artifact was made.

    Attributes:
        stage: name of the stage.
        options: its configuration keys with their values.
        origin: ``synthetic`` if anything it was made from is synthetic, else ``real``.
        inputs: digest of each artifact it was made from, by file name.
        models: hash of each model it was made with, by the key of its checkpoint.
        code: content hash of the code that the stage executes.
        versions: of egosplat, Python and the libraries that do the work.
        created: UTC time at which the stage began.
        started: the same on the process's monotonic clock [s].
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

    def record(self) -> dict[str, Any]:
        """Plain JSON values, with wall time and peak memory as of now."""
        values = {key: value for key, value in asdict(self).items() if key != "started"}
        peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        cost = {"wall_s": time.perf_counter() - self.started, "peak_memory_mb": peak_kb / 1024}
        return values | {key: round(value, 3) for key, value in cost.items()}


def begin(
    stage: str,
    options: Mapping[str, Any],
    origin: str,
    inputs: Mapping[str, str] | None = None,
    models: Mapping[str, str] | None = None,
) -> Provenance:
    """The provenance of an artifact that ``stage`` starts to make now."""
    versions = {"egosplat": egosplat.__version__, "python": sys.version.split()[0]}
    versions |= {name: metadata.version(name) for name in STAGES[stage].libraries}
    return Provenance(
        stage=stage,
        options=dict(sorted(options.items())),
        origin=origin,
        inputs=dict(sorted((inputs or {}).items())),
        models=dict(sorted((models or {}).items())),
        code=code_of(stage),
        versions=versions,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        started=time.perf_counter(),
    )

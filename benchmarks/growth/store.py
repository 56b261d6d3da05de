"""The file of measurements. It is written after each point, so a stopped measurement can be resumed."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

from benchmarks.growth.readings import Run
from egosplat.files import atomic_file

# The fields that hold runs.
RUNS = ("points", "scenes", "checks")


@dataclass
class Measured:
    """All measurements so far.

    Attributes:
        machine: processor and cores, as text.
        points: the runs of each point of the design, by its name.
        scenes: runs of finished scenes that laws are fitted to as well, by scene.
        checks: runs of scenes that no law is fitted to, by scene.
        published: seconds by unit; see ``benchmarks.growth.published``.
    """

    machine: str = ""
    points: dict[str, list[Run]] = field(default_factory=dict)
    scenes: dict[str, list[Run]] = field(default_factory=dict)
    checks: dict[str, list[Run]] = field(default_factory=dict)
    published: dict[str, float] = field(default_factory=dict)

    @property
    def runs(self) -> list[Run]:
        """The runs of all points and scenes that laws are fitted to."""
        return [run for runs in (*self.points.values(), *self.scenes.values()) for run in runs]


def load(path: Path) -> Measured:
    """The measurements in a file; empty if it does not exist."""
    if not path.exists():
        return Measured()
    document = json.loads(path.read_text())
    for kind in RUNS:
        document[kind] = {name: [Run(**run) for run in runs] for name, runs in document[kind].items()}
    return Measured(**document)


def save(path: Path, measured: Measured) -> None:
    """Write the file atomically, one run a line."""
    document = asdict(measured)
    with atomic_file(path) as scratch:
        scratch.write_text(_lines(document) + "\n")


def _lines(document: dict) -> str:
    parts = []
    for name, value in document.items():
        if name in RUNS:
            groups = (
                f"  {json.dumps(key)}: [\n   " + ",\n   ".join(map(json.dumps, runs)) + "\n  ]"
                for key, runs in value.items()
            )
            parts.append(f" {json.dumps(name)}: {{\n" + ",\n".join(groups) + "\n }")
        else:
            parts.append(f" {json.dumps(name)}: {json.dumps(value)}")
    return "{\n" + ",\n".join(parts) + "\n}"

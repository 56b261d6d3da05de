"""How what was scored came about: every artifact on the way, what it cost, and which models made it."""

from typing import Any

from egosplat.artifacts.lineage import Lineage
from egosplat.artifacts.reader import Artifact
from egosplat.models.configs import SMALL

_MIB = 2**20


def artifact_entries(made_from: Lineage) -> dict[str, dict[str, Any] | None]:
    """Provenance, digest and size on disk [MiB] of each artifact by file name, what it cost among it; of one that was
    trained, the time that this took altogether [s], interruptions left out. None of a lost one."""
    known = {name: artifact.provenance | _measured(artifact) for name, artifact in made_from.found.items()}
    return known | dict.fromkeys(made_from.lost)


def total_cost(made_from: Lineage, own: dict[str, Any]) -> dict[str, float | None]:
    """Wall time of all stages one after the other [s] and the largest peak memory [MiB]; None if an artifact is lost.

    Args:
        made_from: all artifacts.
        own: the record of what is being made itself.
    """
    if made_from.lost:
        return {"wall_s": None, "peak_memory_mb": None}
    records = [own, *(artifact.provenance for artifact in made_from.found.values())]
    return {
        "wall_s": round(sum(record["wall_s"] for record in records), 3),
        "peak_memory_mb": max(record["peak_memory_mb"] for record in records),
    }


def models_used(made_from: Lineage) -> dict[str, dict[str, Any]]:
    """Of each model by the key of its checkpoint: its value, content hash, and whether it is the small one shipped."""
    return {
        key: {
            "checkpoint": artifact.provenance["options"][key],
            "hash": content,
            "small": artifact.provenance["options"][key] == SMALL,
        }
        for artifact in made_from.found.values()
        for key, content in sorted(artifact.provenance["models"].items())
    }


def _measured(artifact: Artifact) -> dict[str, Any]:
    size = sum(file.stat().st_size for file in artifact.path.rglob("*") if file.is_file())
    measured = {"digest": artifact.digest, "disk_mb": round(size / _MIB, 3)}
    if "training_s" in artifact.facts:
        measured["training_s"] = artifact.facts["training_s"]
    return measured

"""Summarise how a scored scene was made: its artifacts, their cost, and the models used."""

from typing import Any

from egosplat.artifacts.lineage import Lineage
from egosplat.artifacts.reader import Artifact
from egosplat.models.configs import SMALL

_MIB = 2**20


def artifact_entries(made_from: Lineage) -> dict[str, dict[str, Any] | None]:
    """Provenance, digest and size on disk [MiB] of each artifact, by file name; None for a lost artifact.

    A trained artifact also has its total training time [s], without interruptions.
    """
    known = {name: artifact.provenance | _measured(artifact) for name, artifact in made_from.found.items()}
    return known | dict.fromkeys(made_from.lost)


def total_cost(made_from: Lineage, own: dict[str, Any]) -> dict[str, float | None]:
    """Sum of the wall times of all stages [s] and the largest peak memory [MiB]; None if an artifact is lost."""
    if made_from.lost:
        return {"wall_s": None, "peak_memory_mb": None}
    records = [own, *(artifact.provenance for artifact in made_from.found.values())]
    return {
        "wall_s": round(sum(record["wall_s"] for record in records), 3),
        "peak_memory_mb": max(record["peak_memory_mb"] for record in records),
    }


def models_used(made_from: Lineage) -> dict[str, dict[str, Any]]:
    """Checkpoint, content hash and whether it is the bundled small model, by the checkpoint's configuration key."""
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

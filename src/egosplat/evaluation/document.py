"""Build the entries of ``metrics.json``, with how the scene was made."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from egosplat.artifacts.lineage import Lineage
from egosplat.artifacts.provenance import Provenance
from egosplat.artifacts.reader import Artifact
from egosplat.evaluation.evaluation_frames import Evaluation, RegionScore, summarise_rendering
from egosplat.evaluation.scores import AnsweredQuery, pixel_accuracy, summarise
from egosplat.models.checkpoints import SMALL

# Raised with every change of the schema (pipeline/schemas/metrics.schema.yaml).
FORMAT_VERSION = 7


def finite(value: Any) -> Any:
    """Replace numbers that are not finite by None, and tuples by lists, at any depth."""
    # JSON has no NaN (a mean of nothing) and no infinity (the PSNR of equal images).
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def provenance_entries(run: Provenance, made_from: Lineage, **told: Any) -> dict[str, Any]:
    """The entries on what was measured, with which seed and code, from what, and on what the stage was ``told``."""
    frames, splats, record = made_from.found["frames.zarr"], made_from.found["splats.zarr"], run.record()
    times = frames.read("timestamp_ns")
    return {
        "recording": {
            "kind": frames.facts["format"],
            "name": frames.facts["recording"],
            "hash": frames.digest,
            "frames": len(times),
            "seconds": round(float(times[-1] - times[0]) * 1e-9, 3),
            "seed": told["world_seed"],
            "camera": told["camera"],
        },
        "seed": splats.provenance["options"]["seed"],
        "preset": told["preset"],
        "commit": record["commit"],
        "clean": record["clean"],
        "format_version": FORMAT_VERSION,
        "origin": run.origin,
        "provenance": record,
        "models": models_used(made_from),
        "artifacts": {name: _artifact_entry(artifact) for name, artifact in made_from.found.items()}
        | dict.fromkeys(made_from.lost),
    }


def answer_entries(
    answered: Sequence[AnsweredQuery],
    evaluation: Evaluation,
    rendering: Sequence[Mapping[str, RegionScore]],
    masks: str,
) -> dict[str, Any]:
    """The entries of queries and evaluation frames with their scores, and with ``metrics.masks`` classes of the pixels."""
    groups = [entry.groups for entry in answered]
    entries = {
        "scores": summarise([entry.query.category for entry in answered], groups),
        "queries": [_query_entry(entry, evaluation) for entry in answered],
        "frames": [
            {
                "frame": frame.index,
                "annotated": frame.annotated,
                "registered": frame.registered,
                "trained_on": frame.trained_on,
                "queries": sum(entry.query.frame == frame.index for entry in answered),
                "rendering": {name: asdict(score) for name, score in rendered.items()},
            }
            for frame, rendered in zip(evaluation.frames, rendering, strict=True)
        ],
        "rendering": summarise_rendering(rendering),
    }
    if masks == "classes":
        entries["pixel_accuracy"] = pixel_accuracy(answered, int(evaluation.valid.sum()))
    return entries


def _query_entry(answered: AnsweredQuery, evaluation: Evaluation) -> dict[str, Any]:
    """The entry of a query, with instances by name."""
    query, instances = answered.query, evaluation.instances
    groups = {
        name: asdict(result) | {"instances": [instances[index].name for index in query.instances[name]]}
        for name, result in answered.groups.items()
    }
    return {"frame": query.frame, "category": query.category, **answered.answer, "groups": groups}


def _artifact_entry(artifact: Artifact) -> dict[str, Any]:
    """Provenance, digest and size on disk [MiB]; of a trained artifact also the time of all runs of its training [s]."""
    size = sum(file.stat().st_size for file in artifact.path.rglob("*") if file.is_file())
    entry = artifact.provenance | {"digest": artifact.digest, "disk_mb": round(size / 2**20, 3)}
    return entry | {name: fact for name, fact in artifact.facts.items() if name == "training_s"}


def one_line(text: str) -> str:
    """Put a given name on one line, without control characters."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())


def describe_models(models: Mapping[str, Mapping[str, Any]]) -> str:
    """The checkpoints of ``models_used`` in words; empty without any."""
    if models and all(model["small"] for model in models.values()):
        return "small checkpoints"
    names = [
        f"{key.removesuffix('_checkpoint')} {one_line(Path(models[key]['checkpoint']).name)}"
        for key in sorted(models)
    ]
    return f"checkpoints {', '.join(names)}" if names else ""


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

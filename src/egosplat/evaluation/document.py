"""Build the entries of ``metrics.json``, with how the scene was made, check them against the schema, and write the file."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from egosplat.artifacts.lineage import Lineage
from egosplat.artifacts.provenance import Provenance
from egosplat.artifacts.reader import Artifact
from egosplat.evaluation.evaluation_frames import Frame
from egosplat.evaluation.intervals import RESAMPLING
from egosplat.evaluation.queries import Mask
from egosplat.evaluation.rendering import RegionScore, summarise_rendering
from egosplat.evaluation.run_queries import CLASSES, AnsweredQuery, pixel_accuracy
from egosplat.evaluation.scores import summarise
from egosplat.files import write_json
from egosplat.frames.recording import Instance
from egosplat.models.configs import SMALL
from egosplat.pipeline.validation import Draft202012Validator, schema

# Raised with every change of the schema (pipeline/schemas/metrics.schema.yaml).
FORMAT_VERSION = 6


def write_metrics(output: Path, document: Mapping[str, Any]) -> None:
    """Check a document against the schema and write it atomically, with sorted keys.

    Raises:
        jsonschema.ValidationError: the document does not match the schema.
    """
    # JSON has no NaN (a mean of nothing) and no infinity (the PSNR of equal images).
    values = finite(document)
    Draft202012Validator(schema("metrics")).validate(values)
    write_json(output, values)


def finite(value: Any) -> Any:
    """Replace numbers that are not finite by None, and tuples by lists, at any depth."""
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def provenance_entries(
    run: Provenance,
    made_from: Lineage,
    seed: int | None,
    preset: str | None,
    world_seed: int | None,
    camera: str | None,
) -> dict[str, Any]:
    """The entries on what was measured, with which preset, seed and code, and on what it was made from.

    Args:
        world_seed, camera: ``synthetic.seed`` and ``synthetic.camera`` of a synthetic apartment; else None.
    """
    frames, record = made_from.found["frames.zarr"], run.record()
    times = frames.read("timestamp_ns")
    return {
        "recording": {
            "kind": frames.facts["format"],
            "name": frames.facts["recording"],
            "hash": frames.digest,
            "frames": len(times),
            "seconds": round(float(times[-1] - times[0]) * 1e-9, 3),
            "seed": world_seed,
            "camera": camera,
        },
        "seed": seed,
        "preset": preset,
        "commit": record["commit"],
        "clean": record["clean"],
        "format_version": FORMAT_VERSION,
        "origin": run.origin,
        "provenance": record,
        "models": models_used(made_from),
        "artifacts": _artifact_entries(made_from),
        "total": _total_cost(made_from, record),
    }


def answer_entries(
    answered: Sequence[AnsweredQuery],
    frames: Sequence[Frame],
    rendering: Sequence[Mapping[str, RegionScore]],
    instances: Sequence[Instance],
    valid: Mask,
    masks: str,
) -> dict[str, Any]:
    """The entries of queries and evaluation frames with their scores, and with masks of classes of the pixels."""
    scores = summarise([one.score for one in answered], RESAMPLING)
    entries = {
        "scores": {name: asdict(score) for name, score in scores.items()},
        "queries": [_query_entry(one, instances) for one in answered],
        "frames": _frame_entries(frames, answered, rendering),
        "rendering": summarise_rendering(rendering),
    }
    if masks == CLASSES:
        counted = [one for one in answered if one.right_pixels is not None]
        asked, right = [one.query.frame for one in counted], [one.right_pixels or 0 for one in counted]
        entries["pixel_accuracy"] = pixel_accuracy(asked, right, int(valid.sum()))
    return entries


def _query_entry(answered: AnsweredQuery, instances: Sequence[Instance]) -> dict[str, Any]:
    """The entry of a query, with instances by name."""
    query, score = answered.query, answered.score
    return {
        "frame": query.frame,
        "category": query.category,
        "relevancy": answered.relevancy,
        "level": answered.level,
        "pixel": answered.pixel,
        "position": None if answered.position is None else answered.position.tolist(),
        "mask_level": answered.mask_level,
        "mask_pixels": answered.mask_pixels,
        "groups": {
            name: asdict(score.groups[name]) | {"instances": [instances[index].name for index in members]}
            for name, members in query.instances.items()
        },
    }


def _frame_entries(
    frames: Sequence[Frame], answered: Sequence[AnsweredQuery], rendering: Sequence[Mapping[str, RegionScore]]
) -> list[dict[str, Any]]:
    """The entries of the evaluation frames, with their numbers of queries and rendering scores by group."""
    return [
        {
            "frame": frame.index,
            "annotated": frame.annotated,
            "registered": frame.registered,
            "trained_on": frame.trained_on,
            "queries": sum(one.query.frame == frame.index for one in answered),
            "rendering": {name: asdict(score) for name, score in scores.items()},
        }
        for frame, scores in zip(frames, rendering, strict=True)
    ]


_MIB = 2**20


def _artifact_entries(made_from: Lineage) -> dict[str, dict[str, Any] | None]:
    """Provenance, digest and size on disk [MiB] of each artifact, by file name; None for a lost artifact.

    A trained artifact also has its total training time [s], without interruptions.
    """
    known = {name: artifact.provenance | _measured(artifact) for name, artifact in made_from.found.items()}
    return known | dict.fromkeys(made_from.lost)


def _total_cost(made_from: Lineage, own: dict[str, Any]) -> dict[str, float | None]:
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

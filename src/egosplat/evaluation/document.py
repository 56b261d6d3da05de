"""``metrics.json``: its parts as plain values, its schema, and how it is written."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from egosplat.evaluation.evaluation_frames import Frame
from egosplat.evaluation.intervals import bounds_of
from egosplat.evaluation.rendering import RegionScore
from egosplat.evaluation.run_queries import Asked
from egosplat.evaluation.scores import GroupScore
from egosplat.frames.recording import Instance
from egosplat.output_files import FileKind, stage_json_kind, write_json
from egosplat.pipeline.validation import Draft202012Validator, schema

FORMAT_VERSION = 3

METRICS = stage_json_kind("metrics")
METHOD_METRICS = stage_json_kind("method_metrics")


def write_metrics(output: Path, document: Mapping[str, Any], kind: FileKind) -> None:
    """Check a document and write it, with sorted keys; the file appears when it is complete.

    Numbers that are not finite (a mean of nothing, the PSNR of equal pictures) become null.

    Raises:
        jsonschema.ValidationError: it is not what the schema describes.
        UserError: something is at ``output`` that is not of this kind.
    """
    values = finite(document)
    Draft202012Validator(schema("metrics")).validate(values)
    write_json(output, values, kind)


def finite(value: Any) -> Any:
    """The same plain value with lists for tuples, and None for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {key: finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def score_entry(score: GroupScore) -> dict[str, Any]:
    """Of a group, with intervals as pairs; null of a single category, or none."""
    return asdict(score) | {
        "accuracy_interval": bounds_of(score.accuracy_interval),
        "mean_iou_interval": bounds_of(score.mean_iou_interval),
    }


def query_entry(asked: Asked, instances: Sequence[Instance], levels: Sequence[str]) -> dict[str, Any]:
    """Of a query; levels and instances by their names."""
    query, score = asked.query, asked.score
    return {
        "frame": query.frame,
        "category": query.category,
        "relevancy": asked.relevancy,
        "level": None if asked.level is None else levels[asked.level],
        "pixel": asked.pixel,
        "position": None if asked.position is None else asked.position.tolist(),
        "mask_level": None if asked.mask_level is None else levels[asked.mask_level],
        "mask_pixels": asked.mask_pixels,
        "groups": {
            name: asdict(score.groups[name]) | {"instances": [instances[index].name for index in own]}
            for name, own in query.instances.items()
        },
    }


def frame_entry(frame: Frame, queries: int, rendering: Mapping[str, RegionScore]) -> dict[str, Any]:
    """Of an evaluation frame, in which so many queries were asked."""
    return {
        "frame": frame.index,
        "annotated": frame.annotated,
        "registered": frame.registered,
        "trained_on": frame.trained_on,
        "queries": queries,
        "rendering": {name: asdict(score) for name, score in rendering.items()},
    }

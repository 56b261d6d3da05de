"""Scores as they lie below results, and the scenes of the rooms whose results methods of others replace."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from egosplat.pipeline import validation
from tests.support.tables import OPTIONS
from tests.unit.evaluation.conftest import annotations, instance_map, instances
from tests.unit.features.conftest import clip_keys, labels, scene

__all__ = ("annotations", "clip_keys", "instance_map", "instances", "labels", "scene")


def least(part: dict[str, Any], whole: dict[str, Any]) -> Any:
    """The least document that a part of a schema allows."""
    if "$ref" in part:
        return least(whole["$defs"][part["$ref"].rpartition("/")[2]], whole)
    if "const" in part or "enum" in part:
        return part.get("const") or part["enum"][0]
    kind = part["type"] if isinstance(part["type"], str) else part["type"][-1]
    if kind == "object":
        return {key: least(part["properties"][key], whole) for key in part.get("required", ())}
    if kind == "array":
        return [least(part["items"], whole)] * part.get("minItems", 0)
    return {"string": "x", "integer": part.get("minimum"), "number": 0.0, "boolean": False}.get(kind)


def scores(accuracy: float, count: int) -> dict[str, dict]:
    share = {"count": count, "categories": 10, "random_pixel": 0.05, "middle_pixel": 0.15}
    share |= {"accuracy": accuracy, "accuracy_interval": [accuracy - 0.1, accuracy + 0.1]}
    iou = accuracy / 2
    share |= {"mean_iou": iou, "mean_iou_interval": [iou - 0.05, iou + 0.05]}
    nothing = dict.fromkeys(share, None) | {"count": 0, "categories": 0}
    return {"static": share, "dynamic": nothing, "all": share}


def queries(accuracy: float, count: int) -> list[dict]:
    """Rows that come to these scores: ten categories, those first in the alphabet found more often."""

    rows = []
    for number in range(count):
        own = {"hit": number < round(accuracy * count), "iou": accuracy / 2, "instances": ["Thing"]}
        own |= {"random_hit": 0.05, "middle_hit": number % 20 < 3}
        asked = {"frame": number % 10, "category": f"thing {number // 10}"}
        asked |= {"relevancy": 0.5, "mask_pixels": 0}
        nowhere = dict.fromkeys(("level", "pixel", "position", "mask_level"))
        rows.append(asked | nowhere | {"groups": {"static": own, "all": own}})
    return rows


@pytest.fixture
def made() -> Callable[..., dict[str, Any]]:
    """``made(annotations={...}, ...)``: entries of a run whose artifacts have these costs."""

    def entries(**costs: dict[str, Any]) -> dict[str, Any]:
        whole = validation.schema("metrics")
        record = least(whole["$defs"]["provenance"], whole)
        artifacts = {
            f"{name}.zarr": record | {"stage": name, "digest": "d"} | own for name, own in costs.items()
        }
        return {"provenance": record | {"stage": "metrics", "options": OPTIONS}, "artifacts": artifacts}

    return entries


@pytest.fixture
def scored(tmp_path) -> Callable[..., Path]:
    """``scored(place, accuracy, ...)``: the path of scores below results."""

    def write(
        place, accuracy=0.5, origin="synthetic", checkpoint="small", options=None, count=100, **more
    ) -> Path:
        schema = validation.schema("metrics")
        parts = schema["properties"]
        clip = {"checkpoint": checkpoint, "hash": "c0de" * 4, "small": checkpoint == "small"}
        document = least(schema, schema) | {
            "counts": {key: least(part, schema) for key, part in parts["counts"]["properties"].items()},
            "presence": least(parts["presence"], schema),
            "length_unit": "m",
            "scene": place.replace("/variants/", ", "),
            "origin": origin,
            "scores": scores(accuracy, count),
            "queries": queries(accuracy, count),
            "models": {"clip_checkpoint": clip},
        }
        document |= more
        document["provenance"]["options"] = OPTIONS | (options or {})
        path = tmp_path / "results" / place / "metrics.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(document))
        return path

    return write


@pytest.fixture
def variant(scored, made) -> Callable[..., Path]:
    """``variant(name, accuracy, minutes, ...)``: the path of scores whose splats took the minutes; None for no splats."""

    def write(name, accuracy=0.5, minutes=10.0, scene="scene1", splats=(), **more) -> Path:
        seconds = {"frames": 1.0, "annotations": 600.0, "splats": minutes and 60.0 * minutes}
        entries = made(
            **{
                stage: {"wall_s": wall, "cpu_s": 2 * wall, "peak_memory_mb": 500.0 + wall, "disk_mb": 10.0}
                | {"machine": "a processor, 2 cores"}
                for stage, wall in seconds.items()
                if wall
            }
        )
        artifacts = entries["artifacts"]
        if splats is None:
            artifacts["splats.zarr"] = None
        elif minutes:
            record = artifacts["splats.zarr"] | dict(splats)
            artifacts["splats.zarr"] = {key: value for key, value in record.items() if value is not None}
        place = f"adt/{scene}" + (f"/variants/{name}" if name else "")
        return scored(place, accuracy, **(entries | more))

    return write

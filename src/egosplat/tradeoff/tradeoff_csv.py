"""A trade-off as CSV: one line a number, for other programs."""

from collections.abc import Iterator, Mapping
from typing import Any

import pandas as pd

from egosplat.output_files import text_kind

_COLUMNS = ("scene", "point", "about", "front", "stage", "measure", "mean", "low", "high", "runs")

TABLE = text_kind("egosplat tradeoff", ".csv", begin=",".join(_COLUMNS[:4]) + ",")


def to_csv(document: Mapping[str, Any]) -> str:
    """All numbers of ``tradeoff.json``, in its units; ``stage`` is empty where all stages are told together."""
    lines = (
        {
            "scene": document["scene"],
            "point": point["label"],
            "about": point["about"],
            "front": point["front"],
        }
        | line
        for point in document["points"]
        for line in (*_measures(point), *_stages(point))
    )
    return pd.DataFrame(lines, columns=list(_COLUMNS)).astype({"runs": "Int64"}).to_csv(index=False)


def _measures(point: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for name, found in point["measures"].items():
        if found:
            bounds = {key: found[key] for key in ("mean", "low", "high")}
            yield {"measure": name, "runs": len(found["runs"]), **bounds}


def _stages(point: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for stage, costs in point["stages"].items():
        yield from ({"stage": stage, "measure": name, "mean": value} for name, value in costs.items())

"""Scores of variants with costs."""

from collections.abc import Callable
from pathlib import Path

import pytest


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

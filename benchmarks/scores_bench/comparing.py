"""Scores of scenes in words, and answers to the same queries held against each other."""

import numpy as np
from numpy.typing import NDArray

from egosplat.benchmark.intervals import IntervalOptions, bootstrap_interval
from egosplat.benchmark.scored_scenes import ScoredScene
from egosplat.benchmark.tables import Cell
from egosplat.errors import UserError

RESAMPLING = IntervalOptions(confidence=0.95, resamples=10_000, seed=0)

SCORES = (("accuracy", "all"), ("accuracy", "static"), ("accuracy", "dynamic"), ("mean_iou", "all"))
"""Those that tables show: name and group of queries."""


def told(cell: Cell) -> str:
    """With its interval, where it has one."""
    if cell.percent is None:
        return "-"
    interval = f" ({cell.interval[0]:.1f} to {cell.interval[1]:.1f})" if cell.interval else ""
    return f"{cell.percent:.1f}{interval}"


def psnr(scene: ScoredScene, pixels: str) -> float:
    """Of held-out frames [dB]."""
    return scene.document["rendering"][pixels]["psnr"]


def seconds(scene: ScoredScene) -> float:
    """On processors, of all stages [s].

    Raises:
        UserError: an artifact is lost, and with it what it took.
    """
    artifacts = scene.document["artifacts"]
    if lost := [name for name, one in artifacts.items() if one is None]:
        raise UserError(f"{scene.path}: {', '.join(lost)} are lost; make them again")
    return sum(one["cpu_s"] for one in (*artifacts.values(), scene.document["provenance"]))


def answers(scene: ScoredScene) -> dict[tuple[int, str], tuple[bool, float]]:
    """Whether each query was found, and the IoU of its mask."""
    rows = scene.document["queries"]
    return {
        (row["frame"], row["category"]): (row["groups"]["all"]["hit"], row["groups"]["all"]["iou"])
        for row in rows
    }


def differences(one: ScoredScene, other: ScoredScene) -> NDArray[np.float64]:
    """(Q, 2) of each query that both were asked: by how much one found it more, by how much its mask's IoU is larger."""
    mine, theirs = answers(one), answers(other)
    return np.array(
        [np.subtract(mine[query], theirs[query], dtype=float) for query in mine if query in theirs]
    )


def difference(values: NDArray[np.float64]) -> str:
    """The mean in percentage points, with its interval."""
    interval = bootstrap_interval(values, RESAMPLING)
    return f"{100 * values.mean():+.1f} ({100 * interval.low:+.1f} to {100 * interval.high:+.1f})"

"""What variants of scenes cost and reach, from their ``metrics.json``, as one frame of numbers."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Any

import pandas as pd

from egosplat.errors import UserError
from egosplat_rivals.scored_scenes import FULL, ScoredScene, check_protocol, find_series, read_scored_scene

# Name of the point that is the scene itself.
SCENE = "the scene"


@dataclass(frozen=True)
class Measure:
    """A cost, a gain or a count, with ``scale`` from the unit in files to that on the page, and decimals there."""

    heading: str
    unit: str
    scale: float
    decimals: int
    about: str = ""

    @property
    def label(self) -> str:
        """Heading and unit."""
        return f"{self.heading} [{self.unit}]" if self.unit else self.heading

    def text(self, value: float | None) -> str:
        """Format a value in the unit of files; ``-`` for an unknown one."""
        return "-" if value is None or pd.isna(value) else f"{value * self.scale:.{self.decimals}f}"


COSTS = {
    "wall_s": Measure("time", "min", 1 / 60, 1, "wall time of stages but the survey, one after the other"),
    "cpu_s": Measure("CPU time", "min", 1 / 60, 1, "processor time of all threads"),
    "peak_memory_mb": Measure("memory", "MiB", 1.0, 0, "peak of all stages"),
    "disk_mb": Measure("disk", "MiB", 1.0, 0, "of all artifacts"),
}
GAINS = {
    "accuracy": Measure("accuracy", "%", 100.0, 1, "share of queries that hit"),
    "mean_iou": Measure("mIoU", "%", 100.0, 1, "mean over all queries"),
    "psnr": Measure("static PSNR", "dB", 1.0, 2, "of static pixels in held-out frames"),
}
COUNTS = {"gaussians": Measure("Gaussians", "", 1.0, 0), "queries": Measure("queries", "", 1.0, 0)}
MEASURES = COSTS | GAINS | COUNTS

# Stages that only score a scene; they do not count in its costs.
EVALUATION = ("annotations", "metrics")


def read_runs(metrics: Sequence[Path]) -> list[ScoredScene]:
    """Read the scores of variants (UserError: a file cannot be read, lacks an artifact, or has another protocol)."""
    runs = [read_scored_scene(path) for path in metrics]
    for run in runs:
        if run.method is not None:
            raise UserError(f"{run.path}: has the scores of {run.method}; give variants of EgoSplat alone")
        if lost := [name for name, entry in run.document["artifacts"].items() if entry is None]:
            raise UserError(
                f"{run.path}: has no costs of {lost[0]}, which was missing.\n"
                f"Delete it and run Snakemake again: rm {quote(str(run.path))}"
            )
    check_protocol(runs)
    return runs


def list_numbers(runs: Sequence[ScoredScene]) -> pd.DataFrame:
    """List all numbers of the variants, in the units of ``metrics.json``; ``stage`` is empty for totals without ``EVALUATION``.

    Columns: scene, point, about, stage, measure, value, and low and high, the interval of a score over categories.
    """
    about = {run.path: series.about for series in find_series(runs) for run in series.scenes.values()}
    lines = (
        {
            "scene": f"{run.dataset}/{run.scene}",
            "point": SCENE if run.variant == FULL else run.variant,
            "about": about[run.path],
            **line,
        }
        for run in runs
        for line in _lines(run)
    )
    return pd.DataFrame(lines).astype({"value": float, "low": float, "high": float})


def mean_points(numbers: pd.DataFrame, stage: str = "") -> pd.DataFrame:
    """Average a stage or the totals over scenes: a row for each point that all scenes have, a column for each measure.

    NaN where a scene has no value; a scene that does without the stage counts as 0.
    """
    own = numbers[numbers.stage == stage].set_index(["scene", "point", "measure"]).value.unstack(sort=False)
    scenes = numbers.groupby("point", sort=False).scene.nunique()
    every = scenes.index[scenes == numbers.scene.nunique()]
    places = pd.MultiIndex.from_product([numbers.scene.unique(), every], names=["scene", "point"])
    by_point = own.reindex(places, fill_value=0.0).groupby("point", sort=False)
    return by_point.agg(lambda values: values.mean(skipna=False))


def find_front(points: pd.DataFrame, cost: str = "wall_s", gain: str = "accuracy") -> list[str]:
    """The Pareto front by increasing cost: all other points cost more, gain less, or are equal."""
    front: list[str] = []
    known = points[[cost, gain]].dropna().sort_values([cost, gain], ascending=[True, False], kind="stable")
    for label, place in known.iterrows():
        # By increasing cost, a point is on the front if it gains more than all cheaper ones.
        if not front or place[gain] > known.loc[front[-1], gain] or place.equals(known.loc[front[-1]]):
            front.append(str(label))
    return front


def best_within(points: pd.DataFrame, gain: str, minutes: float) -> str | None:
    """The point of largest gain within ``minutes`` on the clock; the quicker of two equal ones."""
    front = points.loc[find_front(points, "wall_s", gain)]
    affordable = front[front.wall_s <= 60 * minutes]
    return None if affordable.empty else str(affordable[gain].idxmax())


def _lines(run: ScoredScene) -> Iterator[dict[str, Any]]:
    records = [*run.document["artifacts"].values(), run.document["provenance"]]
    stages = {one["stage"]: {name: one.get(name) for name in COSTS} for one in records}
    for one in records:
        # The wall time of an interrupted stage is that of its last run; the training time is that of all runs.
        stages[one["stage"]]["wall_s"] = max(one["wall_s"], one.get("training_s", 0.0))
    made = pd.DataFrame([own for name, own in stages.items() if name not in EVALUATION], dtype=float)
    # A sum without one of its parts would be too small, without a word.
    totals = {
        name: made[name].agg("max" if name == "peak_memory_mb" else "sum", skipna=False) for name in COSTS
    }
    scores = run.document["scores"]["all"]
    totals |= {name: scores[name] for name in ("accuracy", "mean_iou")}
    totals["psnr"] = run.document["rendering"]["static"]["psnr"]
    totals |= {"gaussians": run.document["counts"]["gaussians"], "queries": scores["count"]}
    for name, value in totals.items():
        low, high = scores.get(f"{name}_interval") or (None, None)
        yield {"stage": "", "measure": name, "value": value, "low": low, "high": high}
    for stage, costs in stages.items():
        yield from ({"stage": stage, "measure": name, "value": value} for name, value in costs.items())

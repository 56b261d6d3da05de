"""Read measured points from ``metrics.json``, one file per seed."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

from egosplat.errors import UserError
from egosplat.evaluation.scored_scenes import ScoredScene, check_protocol, read_scored_scene
from egosplat.evaluation.series import find_series
from egosplat.pipeline.sweeps import PRESET, Setting, shown
from egosplat_rivals.tradeoff.estimates import Chance, Sample, pool


@dataclass(frozen=True)
class Measure:
    """A cost or, if more is better, a gain; with the factor from the unit in files to that on the page, and decimals there."""

    name: str
    heading: str
    unit: str
    scale: float
    decimals: int
    more_is_better: bool
    about: str

    @property
    def label(self) -> str:
        """Heading and unit."""
        return f"{self.heading} [{self.unit}]"

    def text(self, value: float | None) -> str:
        """Format a value in the unit of the page; ``-`` for None."""
        return "-" if value is None else f"{value * self.scale:.{self.decimals}f}"


WALL = Measure(
    "wall_s", "time", "min", 1 / 60, 1, False, "wall time of all stages of the scene, one after the other"
)
CPU = Measure("cpu_s", "CPU time", "min", 1 / 60, 1, False, "processor time of all threads")
MEMORY = Measure("peak_memory_mb", "memory", "MiB", 1.0, 0, False, "peak of all stages")
DISK = Measure("disk_mb", "disk", "MiB", 1.0, 0, False, "of all artifacts")
ACCURACY = Measure("accuracy", "accuracy", "%", 100.0, 1, True, "share of queries that hit")
MEAN_IOU = Measure("mean_iou", "mIoU", "%", 100.0, 1, True, "mean over all queries")
PSNR = Measure("psnr", "static PSNR", "dB", 1.0, 2, True, "of static pixels in held-out frames")

COSTS = (WALL, CPU, MEMORY, DISK)

MEASURES = (*COSTS, ACCURACY, MEAN_IOU, PSNR)

# Stages that only score a scene; they do not count in its costs.
EVALUATION = ("annotations", "metrics")


@dataclass(frozen=True, eq=False)
class MeasuredPoint:
    """A point with its runs.

    Attributes:
        settings: all settings that give this point.
        runs: scores, one per seed.
        recipe: as in ``tradeoff.schema.yaml``: how to make it.
        about: data and checkpoints.
    """

    settings: tuple[Setting, ...]
    runs: tuple[ScoredScene, ...]
    recipe: Mapping[str, Any]
    about: str

    @property
    def label(self) -> str:
        """Name of the point, for the scene itself with the name of its preset."""
        presets = [setting.value for setting in self.settings if setting.knob == PRESET]
        if self.variant is None:
            return f"the scene ({', '.join(presets)})" if presets else "the scene"
        return presets[0] if presets else "; ".join(f"{one.knob}={shown(one.value)}" for one in self.settings)

    @property
    def variant(self) -> str | None:
        """The variant of the first run; None for the scene itself."""
        first = self.runs[0].path.parent
        return first.name if first.parent.name == "variants" else None

    @property
    def queries(self) -> int:
        return self.runs[0].document["scores"]["all"]["count"]

    def sample(self, measure: Measure) -> Sample | None:
        """The values of a measure in all runs; None if a run has no value."""
        values = tuple(_value(run, measure) for run in self.runs)
        return None if None in values else values

    def stage_costs(self) -> dict[str, dict[str, float | None]]:
        """Mean costs over the runs, by stage and measure."""
        runs = [_stages(run) for run in self.runs]
        names = dict.fromkeys(stage for run in runs for stage in run)
        return {stage: mean_costs([run[stage] for run in runs if stage in run]) for stage in names}


def mean_costs(found: Sequence[Mapping[str, float | None]]) -> dict[str, float | None]:
    """The mean of the costs of a stage; None for a cost that is not known of all."""
    values = {cost.name: [one[cost.name] for one in found] for cost in COSTS}
    return {name: None if None in own else fmean(own) for name, own in values.items()}


def read_points(points: Sequence[Mapping[str, Any]]) -> list[MeasuredPoint]:
    """Read the scores of points.

    Args:
        points: ``settings``, pairs of a key and a value, ``recipe``, and ``metrics``, paths of files, of each point.

    Raises:
        UserError: a file cannot be read, misses an artifact, or cannot be compared with the others.
    """
    read = [[_read_run(Path(path)) for path in point["metrics"]] for point in points]
    scenes = [run for runs in read for run in runs]
    check_protocol(scenes)
    first = scenes[0]
    if others := [one for one in scenes if (one.dataset, one.scene) != (first.dataset, first.scene)]:
        raise UserError(
            f"{others[0].path}: is of another scene than {first.path}; compare points of one scene"
        )
    about = {scene.path: series.about for series in find_series(scenes) for scene in series.scenes.values()}
    return [
        MeasuredPoint(
            settings=tuple(Setting(*pair) for pair in point["settings"]),
            runs=tuple(runs),
            recipe=point["recipe"],
            about=about[runs[0].path],
        )
        for point, runs in zip(points, read, strict=True)
    ]


def find_chances(points: Sequence[MeasuredPoint]) -> dict[Measure, Chance]:
    """Pooled chance of all points, by measure; for costs it is that of their logarithms."""
    # Costs vary in proportion to their size, so their logarithms have about the same variance.
    found = {}
    for measure in MEASURES:
        known = [(point, sample) for point in points if (sample := point.sample(measure))]
        step = max((1 / point.queries for point, _ in known), default=0.0) if measure is ACCURACY else 0.0
        samples = [sample for _, sample in known]
        if not measure.more_is_better:
            samples = [tuple(map(math.log, sample)) for sample in samples]
        found[measure] = pool(samples, step)
    return found


def _read_run(path: Path) -> ScoredScene:
    scored = read_scored_scene(path)
    if scored.method is not None:
        raise UserError(
            f"{path}: holds the scores of another method, {scored.method}, which has no stages to compare"
        )
    if lost := [name for name, entry in scored.document["artifacts"].items() if entry is None]:
        raise UserError(
            f"{path}: has no costs of {lost[0]}, which was missing.\nDelete it and run Snakemake again: rm {path}"
        )
    return scored


def _stages(run: ScoredScene) -> dict[str, dict[str, float | None]]:
    """Costs by stage and measure; None if not measured."""
    records = [*run.document["artifacts"].values(), run.document["provenance"]]
    # The wall time of an interrupted stage is that of its last run; the training time is that of all runs.
    return {
        record["stage"]: {cost.name: record.get(cost.name) for cost in COSTS}
        | {WALL.name: max(record["wall_s"], record.get("training_s", 0.0))}
        for record in records
    }


def _value(run: ScoredScene, measure: Measure) -> float | None:
    """The value of a measure; costs include shared stages, but not ``EVALUATION``."""
    if measure is PSNR:
        return run.document["rendering"]["static"]["psnr"]
    if measure in (ACCURACY, MEAN_IOU):
        return run.document["scores"]["all"][measure.name]
    values = [costs[measure.name] for stage, costs in _stages(run).items() if stage not in EVALUATION]
    # A sum without one of its parts would be too small, without a word.
    if None in values:
        return None
    return max(values) if measure is MEMORY else sum(values)

"""``tradeoff.json``: every point with its numbers."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from egosplat.output_files import FileKind, json_kind, write_text_file
from egosplat.pipeline import config as configuration
from egosplat.tables.scored_scenes import CHANCE
from egosplat.tradeoff.estimates import Chance, Estimate, Sample, front, mean, positive_mean
from egosplat.tradeoff.measured import MeasuredPoint, chances
from egosplat.tradeoff.measures import ACCURACY, MEASURES, WALL, Measure

FORMAT_VERSION = 4

TRADEOFF = json_kind("egosplat tradeoff", "format_version", "points", "seeds")


def tradeoff_document(points: Sequence[MeasuredPoint]) -> dict[str, Any]:
    """All that was measured, as plain values; see ``tradeoff.schema.yaml``.

    Args:
        points: the scene itself first.
    """
    first = points[0].runs[0].scored
    confidence = first.protocol["confidence"]
    best, chance = front_of(points, WALL.name, ACCURACY.name), chances(points)
    return {
        "format_version": FORMAT_VERSION,
        "scene": f"{first.dataset}/{first.scene}",
        "origin": first.origin,
        "about": points[0].about,
        "notice": first.document["notice"],
        "machines": sorted({name for point in points for name in _machines(point)}),
        "confidence": confidence,
        "chance": {answerer: first.document["scores"]["all"][answerer] for answerer in CHANCE},
        "seeds": len(points[0].runs),
        "points": [_entry(point, chance, confidence, point in best) for point in points],
    }


def front_of(points: Sequence[MeasuredPoint], cost: str, gain: str) -> list[MeasuredPoint]:
    """The points of the Pareto front of the means of two measures, of those that have both; by cost."""
    measures = {measure.name: measure for measure in MEASURES}
    known = [(point, point.sample(measures[cost]), point.sample(measures[gain])) for point in points]
    known = [(point, left.mean, right.mean) for point, left, right in known if left and right]
    return [known[index][0] for index in front([(left, right) for _, left, right in known])]


def write_document(path: Path, document: dict[str, Any], schema: str, kind: FileKind) -> None:
    """Check a document against the schema of that name and write it, with sorted keys, whole or not at all.

    Raises:
        UserError: something is at ``path`` that is not of this kind.
    """
    configuration.check(document, str(path), against=schema)
    write_text_file(path, json.dumps(document, indent=1, sort_keys=True, allow_nan=False) + "\n", kind)


def _entry(
    point: MeasuredPoint, chance: Mapping[Measure, Chance], confidence: float, on_front: bool
) -> dict[str, Any]:
    samples = {measure: point.sample(measure) for measure in MEASURES}
    return {
        "label": point.label,
        "variant": point.variant,
        "settings": [asdict(one) for one in point.settings],
        "about": point.about,
        "front": on_front,
        "queries": point.queries,
        "gaussians": [run.scored.document["counts"]["gaussians"] for run in point.runs],
        "measures": {
            measure.name: _told(measure, sample, chance[measure], confidence) if sample else None
            for measure, sample in samples.items()
        },
        "stages": point.stage_costs(),
    }


def _told(measure: Measure, sample: Sample, chance: Chance, confidence: float) -> dict[str, Any]:
    found: Estimate = (mean if measure.more_is_better else positive_mean)(sample, chance, confidence)
    return {"runs": list(sample.values), "mean": found.value, "low": found.low, "high": found.high}


def _machines(point: MeasuredPoint) -> list[str]:
    """The machines that made it; none of artifacts that do not tell."""
    documents = (run.scored.document for run in point.runs)
    records = (entry for document in documents for entry in document["artifacts"].values())
    return [entry["machine"] for entry in records if "machine" in entry]

"""Write the files of a trade-off: ``tradeoff.json`` of a scene; CSV and HTML of one or more."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, StrictUndefined

from egosplat.evaluation.scored_scenes import CHANCE
from egosplat.files import write_json
from egosplat.pipeline import config as configuration
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.sweeps import shown
from egosplat.report.tables.page import read_picture
from egosplat.report.tradeoff.estimates import Chance, Estimate, Sample, front, mean, positive_mean
from egosplat.report.tradeoff.measured import (
    ACCURACY,
    CPU,
    EVALUATION,
    MEASURES,
    WALL,
    Measure,
    MeasuredPoint,
    chances,
)
from egosplat.report.tradeoff.scenes import bought, mean_of, mean_points

FORMAT_VERSION = 5

_COLUMNS = ("scene", "point", "about", "front", "stage", "measure", "mean", "low", "high", "runs")

# Generator named in the page's metadata.
GENERATOR = "egosplat tradeoff"


def tradeoff_document(points: Sequence[MeasuredPoint]) -> dict[str, Any]:
    """Build the content of ``tradeoff.json``, see ``tradeoff.schema.yaml``.

    Args:
        points: measured points, the scene itself first.
    """
    first = points[0].runs[0].scored
    confidence = first.protocol["confidence"]
    best, chance = _front(points), chances(points)
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


def write_document(path: Path, document: dict[str, Any]) -> None:
    """Check ``tradeoff.json`` against its schema and write it atomically, with sorted keys."""
    configuration.check(document, str(path), against="tradeoff")
    write_json(path, document)


def to_csv(documents: Sequence[Mapping[str, Any]]) -> str:
    """Write all numbers of ``tradeoff.json`` as CSV, in its units; ``stage`` is empty for totals of all stages."""
    lines = (
        {
            "scene": document["scene"],
            "point": point["label"],
            "about": point["about"],
            "front": point["front"],
        }
        | line
        for document in documents
        for point in document["points"]
        for line in (*_measures(point), *_stages(point))
    )
    return pd.DataFrame(lines, columns=list(_COLUMNS)).astype({"runs": "Int64"}).to_csv(index=False)


def to_html(documents: Sequence[Mapping[str, Any]], picture: Path) -> str:
    """Write the page of one or more ``tradeoff.json``, with their plot.

    Raises:
        UserError: the picture cannot be read.
    """
    template = (resources.files(__package__) / "tradeoff.html.j2").read_text(encoding="utf-8")
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    first, points = documents[0], mean_points(documents)
    measured = {stage for point in points for stage in point["stages"]}
    stages = [name for name in STAGES if name in measured and name not in EVALUATION]
    return environment.from_string(template).render(
        documents=documents,
        first=first,
        title=", ".join(document["scene"] for document in documents),
        machines=sorted({name for document in documents for name in document["machines"]}),
        generator=GENERATOR,
        points=points,
        bought=bought(points),
        mean_of=mean_of,
        shown=shown,
        own=[f"{one['knob']}={shown(one['value'])}" for one in points[0]["settings"]],
        measures=MEASURES,
        gains=tuple(one for one in MEASURES if one.more_is_better),
        times=(WALL, CPU),
        stages=stages + [name for name in EVALUATION if name in measured],
        evaluation=EVALUATION,
        chances={name: first["chance"][key] for key, name in CHANCE.items()},
        confidence=f"{100 * first['confidence']:g} %",
        picture=read_picture(picture),
        asked_otherwise=[one["label"] for one in points if one["queries"] != points[0]["queries"]],
    )


def _front(points: Sequence[MeasuredPoint]) -> list[MeasuredPoint]:
    """The Pareto front of time and accuracy, among the points with both."""
    known = [(point, point.sample(WALL), point.sample(ACCURACY)) for point in points]
    known = [(point, time.mean, accuracy.mean) for point, time, accuracy in known if time and accuracy]
    return [known[index][0] for index in front([means for _, *means in known])]


def _entry(
    point: MeasuredPoint, chance: Mapping[Measure, Chance], confidence: float, on_front: bool
) -> dict[str, Any]:
    samples = {measure: point.sample(measure) for measure in MEASURES}
    return {
        "label": point.label,
        "variant": point.variant,
        "settings": [asdict(one) for one in point.settings],
        "recipe": point.recipe.as_json(),
        "about": point.about,
        "front": on_front,
        "queries": point.queries,
        "gaussians": [run.scored.document["counts"]["gaussians"] for run in point.runs],
        "measures": {
            measure.name: _measure_entry(measure, sample, chance[measure], confidence) if sample else None
            for measure, sample in samples.items()
        },
        "stages": point.stage_costs(),
    }


def _measure_entry(measure: Measure, sample: Sample, chance: Chance, confidence: float) -> dict[str, Any]:
    estimate: Estimate = (mean if measure.more_is_better else positive_mean)(sample, chance, confidence)
    return {"runs": list(sample.values), "mean": estimate.value, "low": estimate.low, "high": estimate.high}


def _machines(point: MeasuredPoint) -> list[str]:
    """The machines of a point's artifacts, without artifacts that do not record one."""
    documents = (run.scored.document for run in point.runs)
    records = (entry for document in documents for entry in document["artifacts"].values())
    return [entry["machine"] for entry in records if "machine" in entry]


def _measures(point: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for name, found in point["measures"].items():
        if found:
            bounds = {key: found[key] for key in ("mean", "low", "high")}
            yield {"measure": name, "runs": len(found["runs"]), **bounds}


def _stages(point: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for stage, costs in point["stages"].items():
        yield from ({"stage": stage, "measure": name, "mean": value} for name, value in costs.items())

"""The files of a trade-off: ``tradeoff.json`` of a scene; CSV and HTML of one or more."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd

from egosplat.evaluation.intervals import RESAMPLING
from egosplat.evaluation.scored_scenes import CHANCE
from egosplat.pipeline.stages import STAGES
from egosplat.pipeline.sweeps import shown
from egosplat.report.html_page import read_picture, render_page
from egosplat_rivals.tables.page import TEMPLATE, Section, plain_table
from egosplat_rivals.tradeoff.estimates import estimate_mean
from egosplat_rivals.tradeoff.measured import (
    CPU,
    EVALUATION,
    MEASURES,
    WALL,
    Measure,
    MeasuredPoint,
    find_chances,
)
from egosplat_rivals.tradeoff.scenes import Entry, bought, mark_front, mean_points

FORMAT_VERSION = 5

_COLUMNS = ("scene", "point", "about", "front", "stage", "measure", "mean", "low", "high", "runs")

# Generator named in the page's metadata.
GENERATOR = "egosplat tradeoff"

_BOUGHT = (
    "Of the points that take no longer on the clock of the machine that measured, one stage after the other: the most "
    "accurate, and the one with the largest PSNR. Minutes between two rows buy what the upper row says."
)
_TIMES = (
    "Time is the wall time of each stage; CPU time varies less if other processes ran at the same time. The PSNR of points "
    "with another frames.resolution is not comparable, because their photographs have another size. paper_scaled has the "
    "paper's settings except resolution, focal length, models and the thresholds of the models. With other models than the "
    "paper's, it says little about the paper."
)
_MACHINES = "These points were run on several machines: their times cannot be compared."
_INTERVALS = (
    "Intervals are Student's intervals over seeds. They assume the same variance for all points (relative variance for "
    "costs) and do not cover other queries or scenes."
)


def tradeoff_document(points: Sequence[MeasuredPoint]) -> dict[str, Any]:
    """Build the content of ``tradeoff.json``, see ``tradeoff.schema.yaml``.

    Args:
        points: measured points, the scene itself first.
    """
    first = points[0].runs[0]
    made = [run.document["artifacts"].values() for point in points for run in point.runs]
    entries = _entries(points)
    mark_front(entries)
    return {
        "format_version": FORMAT_VERSION,
        "scene": f"{first.dataset}/{first.scene}",
        "origin": first.origin,
        "about": points[0].about,
        "notice": first.document["notice"],
        # Some artifacts do not record one.
        "machines": sorted({one["machine"] for artifacts in made for one in artifacts if "machine" in one}),
        "confidence": RESAMPLING.confidence,
        "chance": {answerer: first.document["scores"]["all"][answerer] for answerer in CHANCE},
        "seeds": len(points[0].runs),
        "points": entries,
    }


def _entries(points: Sequence[MeasuredPoint]) -> list[dict[str, Any]]:
    chances = find_chances(points)

    def measure_entry(point: MeasuredPoint, measure: Measure) -> dict[str, Any] | None:
        if (sample := point.sample(measure)) is None:
            return None
        found = estimate_mean(sample, chances[measure], RESAMPLING.confidence, not measure.more_is_better)
        return {"runs": list(sample), **asdict(found)}

    return [
        {
            "label": point.label,
            "variant": point.variant,
            "settings": [asdict(one) for one in point.settings],
            "recipe": point.recipe,
            "about": point.about,
            "front": False,
            "queries": point.queries,
            "gaussians": [run.document["counts"]["gaussians"] for run in point.runs],
            "measures": {measure.name: measure_entry(point, measure) for measure in MEASURES},
            "stages": point.stage_costs(),
        }
        for point in points
    ]


def to_csv(documents: Sequence[Mapping[str, Any]]) -> str:
    """Write all numbers of ``tradeoff.json`` as CSV, in its units; ``stage`` is empty for totals of all stages."""
    lines = (
        {"scene": document["scene"], "point": point["label"]}
        | {name: point[name] for name in ("about", "front")}
        | line
        for document in documents
        for point in document["points"]
        for line in _csv_lines(point)
    )
    return pd.DataFrame(lines, columns=list(_COLUMNS)).astype({"runs": "Int64"}).to_csv(index=False)


def _csv_lines(point: Entry) -> Iterator[dict[str, Any]]:
    for name, found in point["measures"].items():
        if found:
            yield found | {"measure": name, "runs": len(found["runs"])}
    for stage, costs in point["stages"].items():
        yield from ({"stage": stage, "measure": name, "mean": value} for name, value in costs.items())


def to_html(documents: Sequence[Mapping[str, Any]], picture: Path) -> str:
    """Write the page of one or more ``tradeoff.json``, with their plot.

    Raises:
        UserError: the picture cannot be read.
    """
    first, points, several = documents[0], mean_points(documents), len(documents) > 1
    title = ", ".join(document["scene"] for document in documents)
    machines = sorted({name for document in documents for name in document["machines"]})
    style = f"named {first['origin']}"
    front = "The Pareto front of each panel is a line"
    caption = f"{front}: thin for each scene, thick for their mean." if several else f"{front}."
    heading = f"Points, mean of {len(documents)} scenes" if several else "Points"
    sections = [
        Section("plot", pictures=[read_picture(picture, caption)]),
        Section(
            "bought", "What would I get for a number of minutes?", "", _bought_table(points), style, [_BOUGHT]
        ),
        Section("points", heading, "", _points_table(points), style, list(_notes(documents, points))),
        Section("recipes", "Recipes", "", _recipes_table(points), "texts"),
        *(
            Section(f"stages_{one.name}", f"{one.label} of each stage", "", _stages_table(points, one), style)
            for one in (WALL, CPU)
        ),
    ]
    for document in documents if several else ():
        table, recipes = _points_table(document["points"]), _recipes_table(document["points"])
        sections += [
            Section(document["scene"], document["scene"], "", table, f"named {document['origin']}"),
            Section(f"{document['scene']}-recipes", "", "", recipes, "texts"),
        ]
    return render_page(
        *TEMPLATE,
        generator=GENERATOR,
        title=f"Speed against accuracy: {title}, {first['about']}",
        heading=f"Speed against accuracy: {title}",
        intro=[
            f"Measured on {first['about']} (origin: {first['origin']}), {'; '.join(machines) or 'an unknown machine'}.",
            _about_runs(documents),
        ],
        warnings=[
            *(f"Notice on {one['scene']}: {one['notice']}." for one in documents if one["notice"]),
            *([_MACHINES] if len(machines) > 1 else []),
        ],
        sections=sections,
    )


def _about_runs(documents: Sequence[Mapping[str, Any]]) -> str:
    first = documents[0]
    if len(documents) > 1:
        return f"Each number is the mean of {len(documents)} scenes; points that a scene lacks are left out."
    if first["seeds"] > 1:
        return (
            f"Each number is the mean of {first['seeds']} runs with different seeds, with its "
            f"{100 * first['confidence']:g} % interval."
        )
    return "Each point was run once, so the random variation is not known."


def _notes(documents: Sequence[Mapping[str, Any]], points: Sequence[Entry]) -> Iterator[str]:
    first = documents[0]
    about = "; ".join(f"{one.heading}: {one.about}" for one in MEASURES)
    yield (
        f"◆: on the Pareto front of time and accuracy. {about}. A stage that points share counts fully for each of them. "
        f"Evaluation ({', '.join(EVALUATION)}) does not count; its time is in the table below."
    )
    chances = {name: first["chance"][key] for key, name in CHANCE.items()}
    told = (f"{name} {'-' if one is None else f'{100 * one:.1f} %'}" for name, one in chances.items())
    yield f"Accuracy by chance in {first['scene']}: {', '.join(told)}."
    yield _TIMES
    if first["seeds"] > 1 and len(documents) == 1:
        yield _INTERVALS
    if own := [f"{one['knob']}={shown(one['value'])}" for one in points[0]["settings"]]:
        yield f"Settings of the scene itself, and settings that give the same results: {'; '.join(own)}."
    if others := [one["label"] for one in points if one["queries"] != points[0]["queries"]]:
        yield (
            "Points with another number of queries than the scene, so that their scores are partly of other queries: "
            f"{'; '.join(others)}."
        )


def _points_table(points: Sequence[Entry]) -> str:
    return plain_table(
        [
            {
                "Point": f"{point['label']} ◆" if point["front"] else point["label"],
                **{one.label: _cell(point, one) for one in MEASURES},
                "Gaussians": ", ".join(map(str, point["gaussians"])),
                "Queries": point["queries"],
                "Data, checkpoints": point["about"],
            }
            for point in points
        ]
    )


def _cell(point: Entry, measure: Measure) -> str:
    """The mean of a measure, with its interval on a second line."""
    if (found := point["measures"][measure.name]) is None:
        return "-"
    low, high = found["low"], found["high"]
    interval = "" if low is None else f"\n{measure.text(low)}–{measure.text(high)}"
    return measure.text(found["mean"]) + interval


def _bought_table(points: Sequence[Entry]) -> str:
    shown_measures = [WALL, CPU, *(one for one in MEASURES if one.more_is_better)]
    rows = []
    for minutes, *found in bought(points):
        row: dict[tuple[str, str], Any] = {("", "Minutes"): minutes}
        for aim, point in zip(("finds most", "looks best"), found, strict=True):
            row[aim, "Point"] = point["label"] if point else "nothing"
            for one in shown_measures:
                known = point and point["measures"][one.name]
                row[aim, one.label] = one.text(known["mean"]) if known else "-"
        rows.append(row)
    return plain_table(rows)


def _recipes_table(points: Sequence[Entry]) -> str:
    """The command of each point, and the keys that differ from their defaults."""
    return plain_table(
        [
            {
                "Point": point["label"],
                "Command": point["recipe"]["command"],
                "Keys that differ from their defaults": "\n".join(
                    f"{key}: {shown(value)}" for key, value in point["recipe"]["keys"].items()
                )
                or "none",
            }
            for point in points
        ]
    )


def _stages_table(points: Sequence[Entry], time: Measure) -> str:
    measured = {stage for point in points for stage in point["stages"]}
    order = [*(name for name in STAGES if name not in EVALUATION), *EVALUATION]
    stages = [name for name in order if name in measured]
    return plain_table(
        [
            {"Point": point["label"]}
            | {name: time.text(point["stages"].get(name, {}).get(time.name)) for name in stages}
            for point in points
        ]
    )

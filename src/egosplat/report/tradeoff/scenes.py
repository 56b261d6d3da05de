"""Several scenes at once: the mean of the points that all of them have, and what a number of minutes buys."""

from collections.abc import Mapping, Sequence
from typing import Any

from egosplat.report.tradeoff.estimates import front
from egosplat.report.tradeoff.measured import ACCURACY, COSTS, MEASURES, PSNR, WALL, Measure

# An entry of ``points`` in ``tradeoff.json``, or the mean of such entries.
Entry = Mapping[str, Any]

# Minutes for which the page names the best point.
MINUTES = (1, 2, 3, 5, 10, 15, 30, 60, 120, 300, 720, 1440)


def mean_points(documents: Sequence[Mapping[str, Any]]) -> list[Entry]:
    """Average the points of several scenes, by label; points that a scene lacks are left out.

    Args:
        documents: contents of ``tradeoff.json``. One document is returned as it is.

    Returns:
        Entries without intervals; ``front`` is that of the means.
    """
    if len(documents) == 1:
        return list(documents[0]["points"])
    by_label = [{point["label"]: point for point in document["points"]} for document in documents]
    shared = [label for label in by_label[0] if all(label in points for points in by_label)]
    found = [_mean_entry([points[label] for points in by_label]) for label in shared]
    known = [one for one in found if one["measures"][WALL.name] and one["measures"][ACCURACY.name]]
    best = front([(mean_of(one, WALL), mean_of(one, ACCURACY)) for one in known])
    for index in best:
        known[index]["front"] = True
    return found


def mean_of(point: Entry, measure: Measure) -> float | None:
    """The mean of a measure in the unit of the page; None if it is unknown."""
    found = point["measures"][measure.name]
    return None if found is None else found["mean"] * measure.scale


def best_within(points: Sequence[Entry], gain: Measure, minutes: float) -> Entry | None:
    """The point with the largest ``gain`` that takes at most ``minutes`` on the clock; the quicker of two equal ones."""
    affordable = [
        one
        for one in points
        if one["measures"][gain.name] and one["measures"][WALL.name] and mean_of(one, WALL) <= minutes
    ]
    return max(affordable, key=lambda one: (mean_of(one, gain), -mean_of(one, WALL)), default=None)


def bought(points: Sequence[Entry]) -> list[tuple[int, Entry | None, Entry | None]]:
    """What each number of minutes buys: minutes, the point that finds most, the point that looks best.

    Rows that say the same as the row above are left out.
    """
    rows: list[tuple[int, Entry | None, Entry | None]] = []
    for minutes in MINUTES:
        row = (minutes, *(best_within(points, gain, minutes) for gain in (ACCURACY, PSNR)))
        if not rows or row[1:] != rows[-1][1:]:
            rows.append(row)
    return rows


def _mean_entry(points: Sequence[Entry]) -> dict[str, Any]:
    measures = {
        one.name: _mean_measure([point["measures"][one.name] for point in points]) for one in MEASURES
    }
    stages = dict.fromkeys(stage for point in points for stage in point["stages"])
    return {
        **points[0],
        "front": False,
        "queries": sum(point["queries"] for point in points),
        "gaussians": [round(_mean([count for point in points for count in point["gaussians"]]))],
        "measures": measures,
        "stages": {stage: _mean_costs([point["stages"].get(stage) for point in points]) for stage in stages},
    }


def _mean_measure(found: Sequence[Mapping[str, Any] | None]) -> dict[str, Any] | None:
    if None in found:
        return None
    means = [one["mean"] for one in found]
    return {"runs": means, "mean": _mean(means), "low": None, "high": None}


def _mean_costs(found: Sequence[Mapping[str, float | None] | None]) -> dict[str, float | None]:
    """Mean costs of a stage; a scene that does without the stage counts as 0."""
    costs = [dict.fromkeys((one.name for one in COSTS), 0.0) if one is None else one for one in found]
    every = {one.name: [cost[one.name] for cost in costs] for one in COSTS}
    return {name: None if None in values else _mean(values) for name, values in every.items()}


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)

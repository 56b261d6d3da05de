"""Several scenes at once: the mean of the points that all of them have, and what a number of minutes buys."""

from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import Any

from egosplat_rivals.tradeoff.estimates import find_front
from egosplat_rivals.tradeoff.measured import ACCURACY, COSTS, MEASURES, PSNR, WALL, Measure, mean_costs

# An entry of ``points`` in ``tradeoff.json``, or the mean of such entries.
Entry = Mapping[str, Any]

# Minutes for which the page names the best point.
MINUTES = (1, 2, 3, 5, 10, 15, 30, 60, 120, 300, 720, 1440)


def mean_points(documents: Sequence[Mapping[str, Any]]) -> list[Entry]:
    """Average the points of several ``tradeoff.json`` by label; points that a scene lacks are left out.

    The entries have no intervals, and ``front`` is that of the means. One document is returned as it is.
    """
    if len(documents) == 1:
        return list(documents[0]["points"])
    by_label = [{point["label"]: point for point in document["points"]} for document in documents]
    shared = [label for label in by_label[0] if all(label in points for points in by_label)]
    found = [_mean_entry([points[label] for points in by_label]) for label in shared]
    mark_front(found)
    return found


def mark_front(entries: Sequence[dict[str, Any]]) -> None:
    """Mark the entries on the Pareto front of time and accuracy."""
    known = known_points(entries, WALL, ACCURACY)
    for index in find_front([(mean_of(one, WALL), mean_of(one, ACCURACY)) for one in known]):
        known[index]["front"] = True


def known_points(points: Sequence[Entry], *measures: Measure) -> list[Entry]:
    """The points of which all these measures are known."""
    return [one for one in points if all(one["measures"][measure.name] for measure in measures)]


def mean_of(point: Entry, measure: Measure) -> float | None:
    """The mean of a measure in the unit of the page; None if it is unknown."""
    found = point["measures"][measure.name]
    return None if found is None else found["mean"] * measure.scale


def best_within(points: Sequence[Entry], gain: Measure, minutes: float) -> Entry | None:
    """The point of largest ``gain`` within ``minutes`` on the clock; the quicker of two equal ones."""
    affordable = [one for one in known_points(points, gain, WALL) if mean_of(one, WALL) <= minutes]
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
    stages = dict.fromkeys(stage for point in points for stage in point["stages"])
    # A scene that does without a stage counts as 0.
    nothing = dict.fromkeys((one.name for one in COSTS), 0.0)
    return {
        **points[0],
        "front": False,
        "queries": sum(point["queries"] for point in points),
        "gaussians": [round(fmean(count for point in points for count in point["gaussians"]))],
        "measures": {one.name: _mean_measure(points, one) for one in MEASURES},
        "stages": {
            stage: mean_costs([point["stages"].get(stage, nothing) for point in points]) for stage in stages
        },
    }


def _mean_measure(points: Sequence[Entry], measure: Measure) -> dict[str, Any] | None:
    if len(known_points(points, measure)) < len(points):
        return None
    means = [point["measures"][measure.name]["mean"] for point in points]
    return {"runs": means, "mean": fmean(means), "low": None, "high": None}

"""Stage ``tradeoff``: write the speed and accuracy of a scene's points as a page, a plot and tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from egosplat.errors import UserError
from egosplat.output_files import check_output, picture_kind, write_text_file
from egosplat.progress import log
from egosplat.report.figure import label_log_axis, plt, save_figure
from egosplat.tradeoff.estimates import front
from egosplat.tradeoff.measured import ACCURACY, MEAN_IOU, MEMORY, WALL, Measure, read_points
from egosplat.tradeoff.page import PAGE, TABLE, TRADEOFF, to_csv, to_html, tradeoff_document, write_document
from egosplat.tradeoff.points import PRESET

# Stem of the files.
NAME = "tradeoff"


def run(points: Sequence[Mapping[str, Any]], output: Path) -> None:
    """Write ``tradeoff.json``, ``.csv``, ``.png`` and ``.html`` atomically; equal inputs give equal bytes.

    Args:
        points: points as in ``egosplat.tradeoff.measured.read_points``, the scene itself first.
        output: folder of the files, created if it does not exist.

    Raises:
        UserError: a file cannot be read, the scores cannot be compared, or a file would replace something else.
    """
    if not isinstance(points, Sequence) or not points or not all(map(_is_point, points)):
        raise UserError(
            "--points: must be a list of at least one point; each is an object with the lists settings and metrics"
        )
    json, csv, png, html = (output / f"{NAME}.{suffix}" for suffix in ("json", "csv", "png", "html"))
    for path, kind in ((json, TRADEOFF), (csv, TABLE), (png, PICTURE), (html, PAGE)):
        check_output(path, kind)
    document = tradeoff_document(read_points(points))
    write_document(json, document)
    write_text_file(csv, to_csv(document), TABLE)
    draw(document, png)
    write_text_file(html, to_html(document, png), PAGE)
    log(f"{len(points)} points, {document['seeds']} runs each: {html}")


def _is_point(point: object) -> bool:
    return isinstance(point, Mapping) and all(
        isinstance(point.get(name), list) for name in ("settings", "metrics")
    )


PICTURE = picture_kind("egosplat tradeoff")

# Cost and gain of each panel.
PANELS = ((WALL, ACCURACY), (WALL, MEAN_IOU), (MEMORY, ACCURACY))

_BLUE = "tab:blue"


def draw(document: Mapping[str, Any], output: Path) -> None:
    """Plot ``tradeoff.json`` as PNG, atomically.

    A marker is the mean of a point, with its interval. Points of the front are connected and labelled; presets are
    labelled, too.
    """
    figure = plt.figure(figsize=(6.2 * len(PANELS), 5.6), layout="constrained")
    figure.suptitle(f"{document['scene']}: speed against accuracy, {document['about']}", fontsize=13)
    for axes, (cost, gain) in zip(figure.subplots(1, len(PANELS)), PANELS, strict=True):
        _draw_panel(axes, document["points"], cost, gain)
    save_figure(figure, output, PICTURE)


def _draw_panel(axes: Axes, points: Sequence[Mapping[str, Any]], cost: Measure, gain: Measure) -> None:
    known = [one for one in points if one["measures"][cost.name] and one["measures"][gain.name]]
    places = [(_mean(one, cost), _mean(one, gain)) for one in known]
    for point, place in zip(known, places, strict=True):
        around = {"xerr": _around(point, cost), "yerr": _around(point, gain)}
        axes.errorbar(*place, **around, fmt="o", color="0.6", elinewidth=0.8)
    best = front(places)
    columns, rows = ([places[index][axis] for index in best] for axis in (0, 1))
    axes.step(columns, rows, where="post", color=_BLUE, zorder=3)
    axes.plot(columns, rows, "o", color=_BLUE, zorder=4)
    presets = [index for index, one in enumerate(known) if index not in best and _is_preset(one)]
    # No point lies above the front or to its left. Labels of the front go there, other labels below and to the right.
    style = {"textcoords": "offset points", "fontsize": 8, "zorder": 5}
    for index in (*best, *presets):
        side = {"xytext": (-6, 2), "ha": "right"} if index in best else {"xytext": (6, -9), "ha": "left"}
        axes.annotate(known[index]["label"], places[index], **side, **style)
    axes.set(xlabel=f"{cost.heading} [{cost.unit}]", ylabel=f"{gain.heading} [{gain.unit}]")
    if places:
        axes.set_xscale("log")
        label_log_axis(axes.xaxis)
    axes.grid(alpha=0.3, which="both")
    axes.margins(x=0.3)


def _is_preset(point: Mapping[str, Any]) -> bool:
    return any(setting["knob"] == PRESET for setting in point["settings"])


def _mean(point: Mapping[str, Any], measure: Measure) -> float:
    return point["measures"][measure.name]["mean"] * measure.scale


def _around(point: Mapping[str, Any], measure: Measure) -> list[list[float]] | None:
    """Lengths of the error bars below and above, cut off at 0; None without an interval."""
    found = point["measures"][measure.name]
    if found["low"] is None:
        return None
    below = found["mean"] - max(found["low"], 0.0)
    return [[below * measure.scale], [(found["high"] - found["mean"]) * measure.scale]]

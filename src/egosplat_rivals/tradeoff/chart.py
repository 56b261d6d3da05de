"""The plot of a trade-off: a line for each scene, and labels that do not overlap."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from adjustText import adjust_text
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from egosplat.drawing import plt, save_figure
from egosplat.pipeline.sweeps import PRESET
from egosplat_rivals.tradeoff.estimates import find_front
from egosplat_rivals.tradeoff.measured import ACCURACY, CPU, MEAN_IOU, PSNR, WALL, Measure
from egosplat_rivals.tradeoff.scenes import Entry, known_points, mean_of, mean_points

# Cost and gain of each panel.
PANELS = ((WALL, ACCURACY), (CPU, ACCURACY), (CPU, MEAN_IOU), (CPU, PSNR))

# The axis of time: half a minute to a day [min].
_FROM, _TO = 0.5, 1440.0
_TICKS = {0.5: "½ min", **{one: str(one) for one in (1, 2, 5, 10, 20)}, 60: "1 h", 120: "2 h", 300: "5 h"}
_TICKS |= {720: "12 h", 1440: "1 day"}


def draw(documents: Sequence[Mapping[str, Any]], output: Path) -> None:
    """Plot one or more ``tradeoff.json`` as PNG, atomically.

    A marker is the mean of a point, with its interval. The front is connected and labeled; presets are labeled, too. Of
    several scenes, each has a thin line, and the means of all scenes are labeled.
    """
    figure = plt.figure(figsize=(13.5, 10.5), layout="constrained")
    names = ", ".join(document["scene"] for document in documents)
    figure.suptitle(f"{names}: speed against accuracy, {documents[0]['about']}", fontsize=13, wrap=True)
    panels = list(zip(figure.subplots(2, 2).flat, PANELS, strict=True))
    for axes, (cost, gain) in panels:
        _draw_panel(axes, documents, cost, gain)
    # The layout is settled before labels are placed, because their size on the page decides what overlaps.
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes, (cost, gain) in panels:
        _label_points(axes, mean_points(documents), cost, gain)
    save_figure(figure, output)


def _draw_panel(axes: Axes, documents: Sequence[Mapping[str, Any]], cost: Measure, gain: Measure) -> None:
    if len(documents) > 1:
        for number, document in enumerate(documents):
            _draw_line(axes, document["points"], cost, gain, f"C{number + 1}", document["scene"], thin=True)
    name = "mean" if len(documents) > 1 else None
    _draw_line(axes, mean_points(documents), cost, gain, "tab:blue", name, thin=False)
    axes.set(xlabel=cost.heading, ylabel=f"{gain.heading} [{gain.unit}]")
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.set_xlim(min(low, _FROM), max(high, _TO))
    axes.xaxis.set_major_locator(FixedLocator(list(_TICKS)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda minutes, _: _TICKS[minutes]))
    axes.grid(alpha=0.3)
    axes.margins(y=0.2)
    if len(documents) > 1:
        axes.legend(loc="lower right", fontsize=8)


def _draw_line(
    axes: Axes,
    points: Sequence[Entry],
    cost: Measure,
    gain: Measure,
    color: str,
    name: str | None,
    thin: bool,
) -> None:
    """Draw the points of a scene, and their front as a line."""
    known, places = _places(points, cost, gain)
    if not thin:
        for point, place in zip(known, places, strict=True):
            around = {"xerr": _around(point, cost), "yerr": _around(point, gain)}
            axes.errorbar(*place, **around, fmt="o", color="0.6", elinewidth=0.8)
    best = find_front(places)
    columns, rows = ([places[index][axis] for index in best] for axis in (0, 1))
    thick = {"linewidth": 2, "markersize": 6, "zorder": 4}
    style = {"linewidth": 1, "alpha": 0.6, "markersize": 3} if thin else thick
    axes.plot(columns, rows, "o-", drawstyle="steps-post", color=color, label=name, **style)


def _label_points(axes: Axes, points: Sequence[Entry], cost: Measure, gain: Measure) -> None:
    """Label the front and the presets, beside their points and apart from each other."""
    known, places = _places(points, cost, gain)
    best = find_front(places)
    presets = [any(one["knob"] == PRESET for one in point["settings"]) for point in known]
    named = [*best, *(index for index in range(len(known)) if index not in best and presets[index])]
    place_labels(axes, places, {known[index]["label"]: places[index] for index in named})


def _places(
    points: Sequence[Entry], cost: Measure, gain: Measure
) -> tuple[list[Entry], list[tuple[float, float]]]:
    """The points of which both are known, and where they lie."""
    known = known_points(points, cost, gain)
    return known, [(mean_of(one, cost), mean_of(one, gain)) for one in known]


def place_labels(
    axes: Axes, points: Sequence[tuple[float, float]], labels: Mapping[str, tuple[float, float]]
) -> None:
    """Write labels beside their points, apart from each other and from all points; lines lead to those far away."""
    # Left of a point and above it is no front.
    style = {"fontsize": 8, "zorder": 5, "ha": "right", "va": "bottom"}
    texts = [axes.text(*place, text, **style) for text, place in labels.items()]
    if texts:
        columns, rows = zip(*points, strict=True)
        line = {"arrowstyle": "-", "color": "0.5", "linewidth": 0.6}
        adjust_text(texts, columns, rows, ax=axes, arrowprops=line, expand=(1.1, 1.4), iter_lim=500)


def _around(point: Entry, measure: Measure) -> list[list[float]] | None:
    """Lengths of the error bars below and above, cut off at 0; None without an interval."""
    found = point["measures"][measure.name]
    if found["low"] is None:
        return None
    below = found["mean"] - max(found["low"], 0.0)
    return [[below * measure.scale], [(found["high"] - found["mean"]) * measure.scale]]

"""The plot of a trade-off: a line for each scene, and labels that do not overlap."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
from adjustText import adjust_text
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from egosplat.drawing import plt, save_figure
from egosplat_rivals.tradeoff.measured import MEASURES, find_front, mean_points

# Cost and gain of each panel.
PANELS = (("wall_s", "accuracy"), ("cpu_s", "accuracy"), ("cpu_s", "mean_iou"), ("cpu_s", "psnr"))

# The axis of time: half a minute to a day [min].
_FROM, _TO = 0.5, 1440.0
_TICKS = {0.5: "½ min", **{minutes: str(minutes) for minutes in (1, 2, 5, 10, 20)}}
_TICKS |= {60: "1 h", 120: "2 h", 300: "5 h", 720: "12 h", 1440: "1 day"}


def draw(numbers: pd.DataFrame, output: Path) -> None:
    """Plot numbers of ``measured.list_numbers`` as PNG, atomically.

    Points are labeled, and the front is a line: a thin one for each of several scenes, a thick one for their mean.
    """
    scale = pd.Series({name: measure.scale for name, measure in MEASURES.items()})
    scenes = {scene: mean_points(own) * scale for scene, own in numbers.groupby("scene", sort=False)}
    means = mean_points(numbers) * scale
    figure = plt.figure(figsize=(13.5, 10.5), layout="constrained")
    title = f"{', '.join(map(str, scenes))}: speed against accuracy, {numbers.about.iloc[0]}"
    figure.suptitle(title, fontsize=13, wrap=True)
    panels = list(zip(figure.subplots(2, 2).flat, PANELS, strict=True))
    for axes, (cost, gain) in panels:
        for number, (scene, own) in enumerate(scenes.items() if len(scenes) > 1 else ()):
            thin = {"linewidth": 1, "alpha": 0.6, "markersize": 3}
            _draw_front(axes, own, cost, gain, color=f"C{number + 1}", label=scene, **thin)
        axes.plot(means[cost], means[gain], "o", color="0.6")
        _draw_front(axes, means, cost, gain, color="tab:blue", label="mean", linewidth=2, zorder=4)
        _set_axes(axes, cost, gain)
        if len(scenes) > 1:
            axes.legend(loc="lower right", fontsize=8)
    # The layout is settled before labels are placed, because their size on the page decides what overlaps.
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes, (cost, gain) in panels:
        known = means[[cost, gain]].dropna()
        place_labels(axes, dict(zip(known.index, known.itertuples(index=False, name=None), strict=True)))
    save_figure(figure, output)


def _draw_front(axes: Axes, points: pd.DataFrame, cost: str, gain: str, **style) -> None:
    front = points.loc[find_front(points, cost, gain)]
    axes.plot(front[cost], front[gain], "o-", drawstyle="steps-post", **style)


def _set_axes(axes: Axes, cost: str, gain: str) -> None:
    axes.set(xlabel=MEASURES[cost].heading, ylabel=MEASURES[gain].label, xscale="log")
    low, high = axes.get_xlim()
    axes.set_xlim(min(low, _FROM), max(high, _TO))
    axes.xaxis.set_major_locator(FixedLocator(list(_TICKS)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda minutes, _: _TICKS[minutes]))
    axes.grid(alpha=0.3)
    axes.margins(y=0.2)


def place_labels(axes: Axes, labels: Mapping[str, tuple[float, float]]) -> None:
    """Write labels beside their points, apart from each other and from all points; lines lead to those far away."""
    # Left of a point and above it is no front.
    style = {"fontsize": 8, "zorder": 5, "ha": "right", "va": "bottom"}
    texts = [axes.text(*place, text, **style) for text, place in labels.items()]
    if texts:
        columns, rows = zip(*labels.values(), strict=True)
        line = {"arrowstyle": "-", "color": "0.5", "linewidth": 0.6}
        adjust_text(texts, columns, rows, ax=axes, arrowprops=line, expand=(1.1, 1.4), iter_lim=500)

"""Draw what moves from place to place on one page: from where to where, when, and the frame that shows it best."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter, MultipleLocator

from egosplat.arrays import Array, Ints
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import length_unit, seconds_of
from egosplat.drawing import add_name, empty_grid, plt, show, split_page
from egosplat.geometry import ground_axes
from egosplat.histories.known import read_spans
from egosplat.histories.told import clock
from egosplat.report.sheets.sheet import POINTS, below_cameras, palette, sheet

# Maximum number of carries, of photographs, and of those in a row.
CARRIES, PICTURES, COLUMNS = 40, 12, 6

# Width of a photograph, height of a bar with its gap, and least height of the charts [inches].
CELL, BAR, CHARTS = 2.7, 0.23, 8.0

# Side of a photograph by the longer side of the thing's box, and its least side [px].
AROUND, LEAST_SIDE = 2.0, 48

# Light of the colors by that of instances: yellow on white is hard to see.
DARKER = 0.8

# Bend of an arrow by its length: ways there and back do not cover each other.
BEND = 0.15

# Seconds between the ticks of the time line: the first with at most ten ticks.
TICKS = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600)


@sheet("histories")
def run(frames: Artifact, poses: Artifact, splats: Artifact, histories: Artifact) -> tuple[Figure, str]:
    """Draw the ways of the carries from above, their times, and photographs of the longest."""
    times = seconds_of(frames)
    first, last, _ = read_spans(histories, "carries", ("first_frame", "last_frame", "best_frame"), len(times))
    spans = np.stack([times[first], times[last]], axis=1)
    count, colors = len(spans), DARKER * palette(len(spans))
    order = np.argsort(spans[:, 0] - spans[:, 1], kind="stable")
    drawn, longest = np.sort(order[:CARRIES]), order[:PICTURES]
    rows = -(-len(longest) // COLUMNS)
    heights = [max(CHARTS, BAR * len(drawn)), *([rows * (CELL + 0.3) + 0.4] if rows else [])]
    figure = plt.figure(figsize=(CELL * COLUMNS, sum(heights) + 0.9), layout="constrained")
    parts = split_page(figure, len(heights), 1, height_ratios=heights)
    above, *beside = parts[0].subplots(1, len(heights), squeeze=False)[0]
    _draw_from_above(above, poses, splats, histories, colors, drawn)
    if count:
        _draw_times(beside[0], spans, times[-1], colors, drawn)
        _draw_photographs(parts[1], frames, histories, spans, colors, longest)
    told = f"movements of objects, hands or people: {count}" if count else "nothing moved from place to place"
    told += f", of which the {CARRIES} longest are drawn" if count > CARRIES else ""
    told += f"; {histories.facts['tracks']} moving objects were tracked; origin {histories.origin}"
    return figure, told + ("\nEach movement has one number and one color in all charts." if count else "")


def _draw_from_above(
    axes: Axes, poses: Artifact, splats: Artifact, histories: Artifact, colors: Array, drawn: Ints
) -> None:
    """Draw an arrow for each carry that is drawn over the Gaussians, without what is higher than the cameras."""
    plane, xyz = ground_axes(poses.read("up")), splats.read("means").astype(np.float64)
    xyz = xyz[below_cameras(poses, xyz)]
    axes.scatter(*(xyz[:: len(xyz) // POINTS + 1] @ plane.T).T, s=1.5, c="0.8", linewidths=0)
    starts, ends = (histories.read(f"carries/{name}") @ plane.T for name in ("start", "end"))
    # Where one of both is not known, the other alone is drawn.
    starts, ends = np.where(np.isfinite(starts), starts, ends), np.where(np.isfinite(ends), ends, starts)
    for index in drawn[np.isfinite(ends[drawn]).all(axis=1)]:
        start, end, color = starts[index], ends[index], colors[index]
        style = {"arrowstyle": "-|>", "connectionstyle": f"arc3,rad={BEND}", "linewidth": 1.8, "shrinkA": 0}
        axes.annotate("", tuple(end), tuple(start), arrowprops=style | {"shrinkB": 0, "color": color})
        # An arrow does not widen the axes, so its end is a dot without a size.
        axes.scatter(*np.stack([start, end], axis=1), s=(14, 0), color=color)
        x, y = (start + end) / 2 + BEND / 2 * (end - start)[::-1] * (1, -1)
        box = {"facecolor": "white", "edgecolor": color, "pad": 0.5}
        # Names move apart by their letters: spaces keep their frames apart, too.
        add_name(axes, x, y, f" {index + 1} ", color="black", bbox=box, zorder=4)
    unit, title = length_unit(poses), "From above: from where to where they moved"
    axes.set(aspect="equal", title=title, xlabel=unit, ylabel=unit)


def _draw_times(axes: Axes, spans: Array, last: float, colors: Array, drawn: Ints) -> None:
    """Draw a bar for each carry that is drawn, from its first to its last frame."""
    places, spans = np.arange(1, len(drawn) + 1), spans[drawn]
    axes.barh(places, np.ptp(spans, axis=1), left=spans[:, 0], color=colors[drawn], height=0.7, zorder=2)
    axes.set(title="When they moved", xlabel="time [min:s]", ylim=(len(drawn) + 0.6, 0.4), xlim=(0, last))
    axes.set_yticks(places, [str(index + 1) for index in drawn])
    axes.xaxis.set_major_locator(
        MultipleLocator(next((tick for tick in TICKS if last <= 10 * tick), TICKS[-1]))
    )
    axes.xaxis.set_major_formatter(FuncFormatter(lambda second, _: clock(second)))
    axes.grid(alpha=0.3)


def _draw_photographs(
    page: FigureBase, frames: Artifact, histories: Artifact, spans: Array, colors: Array, chosen: Ints
) -> None:
    """Draw the chosen things on their way, each in the frame that shows most of it."""
    left_out = len(spans) - len(chosen)
    rest = f"; {left_out} shorter ones are left out" if left_out else ""
    page.suptitle(f"The frame that shows most of the object, the longest time first{rest}")
    cells = empty_grid(page, -(-len(chosen) // COLUMNS), COLUMNS)
    best, boxes = (histories.read(f"carries/{name}") for name in ("best_frame", "box"))
    for axes, index in zip(cells.flat, chosen.tolist(), strict=False):
        picture, box = frames.row("rgb", int(best[index])), boxes[index]
        height, width, _ = picture.shape
        side = min(max(LEAST_SIDE, round(AROUND * int((box[2:] - box[:2]).max()))), height, width)
        left, top = np.clip((box[:2] + box[2:] - side) // 2, 0, [width - side, height - side]).tolist()
        told = f"{index + 1}: {clock(spans[index, 0])} to {clock(spans[index, 1])}"
        show(axes, picture[top : top + side, left : left + side], told, 10)
        corner, size = (box[0] - left - 0.5, box[1] - top - 0.5), box[2:] - box[:2]
        axes.add_patch(Rectangle(corner, *size, fill=False, edgecolor=colors[index], linewidth=1.5))

"""A scene's queries on one page: those that were answered best, and those that were answered worst."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from egosplat.output_files import check_output, picture_kind
from egosplat.report.answer_drawing import draw_heat, draw_mask
from egosplat.report.figure import draw_heading, plt, save_figure
from egosplat.report.queries_asking import ShownQuery, ask_again, open_sources
from egosplat.report.queries_choice import best_and_worst, scored_queries
from egosplat.tables.scored_scenes import CHANCE, ScoredScene, read_scored_scene
from egosplat.tables.series import find_series
from egosplat.tables.table import Cell

PAGE = picture_kind("egosplat queries-sheet")

ROWS = 4
"""At most so many queries are shown of the best, and of the worst."""

CELL = 2.9
"""Width of a picture on the page, in inches."""

HIT, MISS = ("found", "o", "forestgreen"), ("missed", "X", "red")
"""Word, mark and colour of what was found at its place, and of what was not."""

BEST = "best: found at their place, the highest IoU first; a row a category"
WORST = "worst: missed, the lowest IoU first, of equal ones the surest; a row a category"
"""What the blocks are called."""


def run(
    frames: Path,
    poses: Path,
    annotations: Path,
    features: Path,
    splats: Path,
    language: Path,
    metrics: Path,
    output: Path,
    *,
    title: str,
) -> None:
    """Draw the page as PNG; the file appears when it is complete.

    Queries are asked again as ``metrics.json`` says that they were asked; their scores are those that it tells.

    Raises:
        UserError: the inputs do not belong together, or the features' OpenCLIP is not there any more.
    """
    check_output(output, PAGE)
    scored = read_scored_scene(metrics)
    sources = open_sources((frames, poses, annotations, features, splats, language), scored)
    best, worst = best_and_worst(scored_queries(scored.document), ROWS)
    options = scored.document["provenance"]["options"]
    shown = {one.scored: one for one in ask_again([*best, *worst], sources, options)}
    figure = plt.figure(layout="constrained")
    if shown:
        blocks = ([shown[one] for one in queries] for queries in (best, worst))
        _draw(figure, *blocks, _hits_boxes(scored))
    else:
        figure.set_size_inches(6 * CELL, CELL)
        figure.text(0.5, 0.4, "No annotated frame with a pose shows anything to ask for.", ha="center")
    draw_heading(figure, f"{title}: {summary(scored)}", scored.warnings)
    save_figure(figure, output, PAGE)


def summary(scored: ScoredScene) -> str:
    """The scores of all queries, with what they come from; below it how to read the page."""
    about = f"origin {scored.origin}, {find_series([scored])[0].checkpoints}"
    if not scored.document["scores"]["all"]["count"]:
        return f"no queries; {about}"
    accuracy, mean_iou = (scored.cell(name, "all") for name in ("accuracy", "mean_iou"))
    chance = ", ".join(f"{name} {scored.chance(key, 'all').percent:.1f} %" for key, name in CHANCE.items())
    return (
        f"{accuracy.queries} queries; accuracy {_told(accuracy)}, mIoU {_told(mean_iou)}; chance: {chance}; {about}\n"
        f"white: what was asked for, as annotated{', dashed its box' if _hits_boxes(scored) else ''}; "
        "colours: relevancy, from 0 (blue) to 1 (red); mark: the most relevant pixel, green where it hits, red where not"
    )


def _hits_boxes(scored: ScoredScene) -> bool:
    """Whether a box had to be hit, not the pixels in it."""
    return scored.protocol["target"] == "box"


def _told(score: Cell) -> str:
    """In percent, with its interval; of a single category there is none."""
    interval = f" ({score.interval[0]:.1f} to {score.interval[1]:.1f})" if score.interval else ""
    return f"{score.percent:.1f} %{interval}"


def _draw(figure: Figure, best: Sequence[ShownQuery], worst: Sequence[ShownQuery], boxes: bool) -> None:
    """The two blocks beside each other."""
    height, width = (*best, *worst)[0].truth.shape
    rows = max(len(best), len(worst))
    figure.set_size_inches(6 * CELL, (CELL * height / width + 0.12) * rows + 0.9)
    left, right = figure.subfigures(1, 2, wspace=0.02)
    for page, name, queries in ((left, BEST, best), (right, WORST, worst)):
        page.suptitle(name if queries else f"{name.partition(':')[0]}: none", fontsize=11, fontweight="bold")
        _draw_block(page, queries, rows, boxes)


def _draw_block(page: SubFigure, queries: Sequence[ShownQuery], rows: int, boxes: bool) -> None:
    grid = page.subplots(rows, 3, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for cells, query in zip(grid, queries, strict=False):
        _draw_query(cells, query, boxes)


def _draw_query(cells: NDArray[np.object_], query: ShownQuery, boxes: bool) -> None:
    """What was asked for, where it was looked for, and what was taken for it."""
    photograph, heat, mask = cells
    scored, answer = query.scored, query.answer
    photograph.imshow(query.photograph)
    photograph.set_title(f'"{scored.category}", frame {scored.frame}', fontsize=9)
    draw_heat(heat, query.view, answer.relevancy)
    said, marker, colour = HIT if scored.hit else MISS
    heat.set_title(f"{said}, relevancy {scored.relevancy:.2f}", fontsize=9, color=colour)
    draw_mask(mask, query.view, answer.mask)
    mask.set_title(f"mask: IoU {scored.iou:.2f}", fontsize=9)
    for axes in cells:
        _outline(axes, query.truth)
    if boxes:
        _draw_boxes(photograph, query.boxes)
        _draw_boxes(heat, query.boxes)
    if answer.pixel is not None:
        heat.scatter(*answer.pixel, s=110, marker=marker, color=colour, edgecolors="white", linewidths=1.5)


def _outline(axes: Axes, mask: NDArray[np.bool_]) -> None:
    """Of a mask, in white on black."""
    if mask.any() and not mask.all():
        axes.contour(mask, levels=[0.5], colors="black", linewidths=1.8)
        axes.contour(mask, levels=[0.5], colors="white", linewidths=0.9)


def _draw_boxes(axes: Axes, boxes: NDArray[np.int64]) -> None:
    """Dashed, around the outermost pixels."""
    for x0, y0, x1, y1 in boxes:
        place, size = (x0 - 0.5, y0 - 0.5), (x1 - x0 + 1, y1 - y0 + 1)
        axes.add_patch(Rectangle(place, *size, fill=False, edgecolor="white", linestyle="--", linewidth=0.9))

"""Draw the best and the worst answers of a scene's queries on one page."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import HISTORIES
from egosplat.drawing import (
    HIT,
    MISS,
    draw_heading,
    draw_heat,
    draw_mask,
    draw_outline,
    empty_grid,
    plt,
    save_figure,
    split_page,
)
from egosplat.evaluation.evaluation_frames import SCORED
from egosplat.evaluation.scored_scenes import CHANCE, Cell, ScoredScene, read_scored_scene
from egosplat.query.finished_scene import open_encoded, scene_of
from egosplat.report.sheets.queries_asking import (
    ShownQuery,
    ask_again,
    best_and_worst,
    scored_queries,
    scoring_options,
)

# Maximum number of best queries, and of worst ones.
ROWS = 4

# Width of an image on the page [inches].
CELL = 2.9

# Titles of the two blocks.
BEST = "best: hits with the highest IoU, one per category"
WORST = "worst: misses with the lowest IoU, then the highest relevancy, one per category"


def run(
    frames_path: Path,
    poses_path: Path,
    annotations_path: Path,
    splats_path: Path,
    language_path: Path,
    metrics_path: Path,
    output: Path,
    *,
    title: str,
    features_path: Path | None = None,
    tiles_path: Path | None = None,
    histories_path: Path | None = None,
) -> None:
    """Draw the page as PNG, atomically.

    Queries are answered again with the options of ``metrics.json``; the scores are those of ``metrics.json``.
    ``histories_path`` is required if the scores are of frames at their own time.

    Raises:
        UserError: the inputs do not belong together, or the features' OpenCLIP is missing.
    """
    scored = read_scored_scene(metrics_path)
    paths = (frames_path, poses_path, annotations_path, splats_path, language_path)
    artifacts = [*map(open_artifact, paths, SCORED), open_encoded(features_path, tiles_path)]
    artifacts += [] if histories_path is None else [open_artifact(histories_path, HISTORIES)]
    scene = scene_of(artifacts, scoring_options(scored))
    best, worst = best_and_worst(scored_queries(scored.document), ROWS)
    shown = {one.scored: one for one in ask_again([*best, *worst], scene, scored)}
    figure = plt.figure(layout="constrained")
    if shown:
        blocks = ([shown[one] for one in queries] for queries in (best, worst))
        _draw(figure, *blocks, boxes=_hits_boxes(scored))
    else:
        figure.set_size_inches(6 * CELL, CELL)
        figure.text(0.5, 0.4, "No annotated frame with a pose has a category to query.", ha="center")
    draw_heading(figure, f"{title}: {summary(scored)}", scored.warnings)
    save_figure(figure, output)


def summary(scored: ScoredScene) -> str:
    """Scores of all queries with data and checkpoints; on the second line, a legend of the page."""
    about = f"origin {scored.origin}, {scored.checkpoints}"
    if not scored.document["scores"]["all"]["count"]:
        return f"no queries; {about}"
    accuracy, mean_iou = (scored.cell(name, "all") for name in ("accuracy", "mean_iou"))
    chance = ", ".join(f"{name} {scored.chance(key, 'all').percent:.1f} %" for key, name in CHANCE.items())
    return (
        f"{accuracy.queries} queries; accuracy {_percent(accuracy)}, mIoU {_percent(mean_iou)}; chance: {chance}; "
        f"{about}\nwhite: annotated instances{', dashed: their boxes' if _hits_boxes(scored) else ''}; "
        "colors: relevancy from 0 (blue) to 1 (red); marker: the most relevant pixel, green for a hit, red for a miss"
    )


def _hits_boxes(scored: ScoredScene) -> bool:
    """Whether the boxes of instances had to be hit, not their pixels."""
    return scored.document["provenance"]["options"]["hit_region"] == "box"


def _percent(score: Cell) -> str:
    """A score in percent, with its interval if it has one."""
    interval = f" ({score.interval[0]:.1f} to {score.interval[1]:.1f})" if score.interval else ""
    return f"{score.percent:.1f} %{interval}"


def _draw(figure: Figure, best: Sequence[ShownQuery], worst: Sequence[ShownQuery], boxes: bool) -> None:
    """Draw the best queries on the left and the worst ones on the right."""
    height, width = (*best, *worst)[0].target.shape
    rows = max(len(best), len(worst))
    figure.set_size_inches(6 * CELL, (CELL * height / width + 0.12) * rows + 0.9)
    left, right = split_page(figure, 1, 2, wspace=0.02)
    for page, name, queries in ((left, BEST, best), (right, WORST, worst)):
        page.suptitle(name if queries else f"{name.partition(':')[0]}: none", fontsize=11, fontweight="bold")
        for cells, query in zip(empty_grid(page, rows, 3), queries, strict=False):
            _draw_query(cells, query, boxes)


def _draw_query(cells: NDArray[Any], query: ShownQuery, boxes: bool) -> None:
    """Draw the photograph, the relevancy and the mask of a query."""
    photograph, heat, mask = cells
    scored, answer = query.scored, query.answer
    photograph.imshow(query.photograph)
    photograph.set_title(f'"{scored.category}", frame {scored.frame}', fontsize=9)
    draw_heat(heat, query.view, answer.relevancy)
    verdict, marker, color = HIT if scored.hit else MISS
    heat.set_title(f"{verdict}, relevancy {scored.relevancy:.2f}", fontsize=9, color=color)
    draw_mask(mask, query.view, answer.mask)
    mask.set_title(f"mask: IoU {scored.iou:.2f}", fontsize=9)
    for axes in cells:
        draw_outline(axes, query.target)
    if boxes:
        _draw_boxes(photograph, query.boxes)
        _draw_boxes(heat, query.boxes)
    if answer.pixel is not None:
        heat.scatter(*answer.pixel, s=110, marker=marker, color=color, edgecolors="white", linewidths=1.5)


def _draw_boxes(axes: Axes, boxes: NDArray[np.int64]) -> None:
    """Draw dashed boxes around the outermost pixels."""
    for x0, y0, x1, y1 in boxes:
        place, size = (x0 - 0.5, y0 - 0.5), (x1 - x0 + 1, y1 - y0 + 1)
        axes.add_patch(Rectangle(place, *size, fill=False, edgecolor="white", linestyle="--", linewidth=0.9))

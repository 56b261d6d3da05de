"""Draw the answers of several methods to the same queries side by side."""

from collections.abc import Sequence
from pathlib import Path
from statistics import fmean

from matplotlib.axes import Axes
from matplotlib.figure import SubFigure

from egosplat.artifacts.lineage import open_histories
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import ANNOTATIONS
from egosplat.drawing import HIT, MISS, draw_heading, draw_heat, draw_outline, empty_grid, plt, save_figure
from egosplat.errors import UserError
from egosplat.evaluation.options import MetricsOptions, recorded_options
from egosplat.query.finished_scene import Scene, open_artifacts, scene_of
from egosplat.report.sheets.queries_sheet import (
    ScoredQuery,
    ShownQuery,
    ask_again,
    best_and_worst,
    scored_queries,
)
from egosplat_rivals.scored_scenes import OWN, read_scored_scene

# Most best queries, and worst ones; width of an image on the page [inches].
ROWS, CELL = 4, 2.1

# Frame and category of a query, and titles of the two blocks.
Asked = tuple[int, str]
BEST = "best: hits of half of the methods with the highest mean IoU, one per category"
WORST = "worst: misses of most methods with the lowest mean IoU, one per category"


def run(metrics: Sequence[Path], output: Path, title: str) -> None:
    """Draw the page as PNG, atomically; queries are answered again, as in the page of queries. ``metrics`` are ``metrics.json`` of
    variants of one scene, each beside its language.zarr, in the order of the columns. UserError if one cannot be read, is of another
    scene than the first, its artifacts are gone, or other queries were scored."""
    scenes = [read_scored_scene(path) for path in metrics]
    for one in scenes:
        if (one.dataset, one.scene) != (scenes[0].dataset, scenes[0].scene):
            raise UserError(f"{one.path}: is of another scene than {metrics[0]}; give variants of one scene")
    by_scene = [{(one.frame, one.category): one for one in scored_queries(each.document)} for each in scenes]
    chosen = best_and_worst(over_methods(by_scene), ROWS)
    best, worst = ([(one.frame, one.category) for one in queries] for queries in chosen)
    shown = []
    for scene, queries in zip(scenes, by_scene, strict=True):
        scored = scene.document["provenance"]
        options, in_time = recorded_options(scored["options"]), "histories.zarr" in scored["inputs"]
        opened = open_scored(scene.path.parent, options, in_time=in_time)
        answers = ask_again([queries[one] for one in (*best, *worst)], opened, scene.document, scene.path)
        shown.append({(one.scored.frame, one.scored.category): one for one in answers})
    names, rows = [scene.method or OWN for scene in scenes], len(best) + len(worst)
    size = (len(scenes) + 1) * CELL, (CELL + 0.25) * max(rows, 1) + 1.2
    figure = plt.figure(figsize=size, layout="constrained")
    if rows:
        parts = figure.subfigures(2, 1, height_ratios=(max(len(best), 0.2), max(len(worst), 0.2)))
        for part, heading, queries in zip(parts, (BEST, WORST), (best, worst), strict=True):
            part.suptitle(heading, fontsize=11, fontweight="bold")
            if queries:
                _draw(part, queries, names, shown)
    else:
        figure.text(0.5, 0.4, "No query was asked of all methods.", ha="center")
    legend = "white: annotated instances; colors: relevancy from 0 (blue) to 1 (red); marker: the most relevant pixel"
    draw_heading(figure, f"{title}\n{legend}", [])
    save_figure(figure, output)


def open_scored(folder: Path, options: MetricsOptions, *, in_time: bool = False) -> Scene:
    """Open a finished scene or variant with its annotations; ``in_time`` to ask frames at their own time, if they can be.
    UserError: as ``open_artifacts``, or the artifacts do not belong together."""
    frames, poses, splats, *others = open_artifacts(folder)
    annotations = open_artifact(frames.path.with_name("annotations.zarr"), ANNOTATIONS)
    histories = open_histories(folder, splats) if in_time else None
    more = [annotations] if histories is None else [annotations, histories]
    return scene_of([frames, poses, splats, *others, *more], options)


def over_methods(methods: Sequence[dict[Asked, ScoredQuery]]) -> list[ScoredQuery]:
    """Average the queries that were asked of all methods: a hit if half of them hit, and the mean of relevancy and IoU."""
    common = set(methods[0]).intersection(*methods[1:])
    return [
        ScoredQuery(
            *asked,
            relevancy=fmean(queries[asked].relevancy for queries in methods),
            hit=2 * sum(queries[asked].hit for queries in methods) >= len(methods),
            iou=fmean(queries[asked].iou for queries in methods),
        )
        for asked in sorted(common)
    ]


def _draw(
    page: SubFigure, queries: Sequence[Asked], names: Sequence[str], shown: Sequence[dict[Asked, ShownQuery]]
) -> None:
    """Draw a row for each query: its photograph, then the relevancy of each method."""
    for cells, asked in zip(empty_grid(page, len(queries), len(names) + 1), queries, strict=True):
        first = shown[0][asked]
        cells[0].imshow(first.photograph)
        cells[0].set_title(f'"{asked[1]}", frame {asked[0]}', fontsize=8)
        draw_outline(cells[0], first.target)
        for axes, name, answers in zip(cells[1:], names, shown, strict=True):
            _draw_answer(axes, name, answers[asked])


def _draw_answer(axes: Axes, name: str, query: ShownQuery) -> None:
    verdict, marker, color = HIT if query.scored.hit else MISS
    draw_heat(axes, query.view, query.answer.relevancy)
    draw_outline(axes, query.target)
    axes.set_title(f"{name}: {verdict}, IoU {query.scored.iou:.2f}", fontsize=8, color=color)
    if query.answer.pixel is not None:
        style = {"s": 60, "color": color, "edgecolors": "white", "linewidths": 1.2}
        axes.scatter(*query.answer.pixel, marker=marker, **style)

"""Draw the best and the worst answers of a scene's queries on one page; they are answered again, to get the maps behind the scores."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from egosplat.alarms.artifact_alarms import warning_lines
from egosplat.alarms.table import Alarm
from egosplat.arrays import Bools, Bytes, Floats, Ints
from egosplat.artifacts.consistency import check_inputs
from egosplat.artifacts.lineage import open_inputs
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
    show,
    split_page,
)
from egosplat.evaluation.document import describe_models
from egosplat.evaluation.evaluation_frames import SCORED, Evaluation, read_evaluation
from egosplat.evaluation.options import recorded_options
from egosplat.evaluation.queries import mask_of, phrases_to_ask, read_layers
from egosplat.evaluation.scores import CHANCE, ask_of, bounding_boxes
from egosplat.pipeline.validation import read_document
from egosplat.query.answers import ViewMatch
from egosplat.query.finished_scene import Scene, scene_of

# Maximum number of best queries, and of worst ones.
ROWS = 4

# Width of an image on the page [inches].
CELL = 2.9

# Titles of the two blocks.
BEST = "best: hits with the highest IoU, one per category"
WORST = "worst: misses with the lowest IoU, then the highest relevancy, one per category"


@dataclass(frozen=True)
class ScoredQuery:
    """A query of ``metrics.json``, scored against all instances of its category; relevancy and IoU are 0..1."""

    frame: int
    category: str
    relevancy: float
    hit: bool
    iou: float


@dataclass(frozen=True, eq=False)
class ShownQuery:
    """A query with its (H, W, 3) uint8 photograph, float32 view in [0, 1], (H, W) bool target, and the (B, 4) boxes to hit, if any."""

    scored: ScoredQuery
    photograph: Bytes
    view: Floats
    target: Bools
    boxes: Ints
    answer: ViewMatch


def run(*, metrics_path: Path, output: Path, title: str, **paths: Path | None) -> None:
    """Draw the page as PNG, whole or not at all, with the options and the scores of ``metrics.json``.

    Histories are required if the scores are of frames at their own time. UserError: the inputs do not belong
    together, or the features' OpenCLIP is missing.
    """
    document = read_document(metrics_path, "metrics")
    scene = scene_of(open_inputs(paths).values(), recorded_options(document["provenance"]["options"]))
    blocks = best_and_worst(scored_queries(document), ROWS)
    asked = ask_again([*blocks[0], *blocks[1]], scene, document, metrics_path)
    shown = {query.scored: query for query in asked}
    rows, (height, width) = max(map(len, blocks)), scene.valid.shape
    size = 6 * CELL, (CELL * height / width + 0.12) * rows + 0.9 if rows else CELL
    figure = plt.figure(figsize=size, layout="constrained")
    if not rows:
        figure.text(0.5, 0.4, "No annotated frame with a pose has a category to query.", ha="center")
    for page, name, block in zip(split_page(figure, 1, 2, wspace=0.02), (BEST, WORST), blocks, strict=True):
        if rows:
            page.suptitle(
                name if block else f"{name.partition(':')[0]}: none", fontsize=11, fontweight="bold"
            )
            for cells, query in zip(empty_grid(page, rows, 3), block, strict=False):
                _draw_query(cells, shown[query])
    warnings = warning_lines(document["notice"], [Alarm(**alarm) for alarm in document["alarms"]])
    draw_heading(figure, f"{title}: {summary(document)}", warnings)
    save_figure(figure, output)


def scored_queries(document: Mapping[str, Any]) -> list[ScoredQuery]:
    """All queries of a ``metrics.json``."""
    return [
        ScoredQuery(
            one["frame"], one["category"], one["relevancy"], *map(one["groups"]["all"].get, ("hit", "iou"))
        )
        for one in document["queries"]
    ]


def best_and_worst(queries: Sequence[ScoredQuery], count: int) -> tuple[list[ScoredQuery], list[ScoredQuery]]:
    """Choose at most ``count`` best and ``count`` worst queries, each of a different category.

    The best ones hit; they are ordered by decreasing IoU. The worst ones miss, and their category is not among the best;
    they are ordered by increasing IoU, then by decreasing relevancy. Ties are ordered by frame and category.
    """
    ordered = sorted(queries, key=lambda query: (query.frame, query.category))
    hits = sorted((query for query in ordered if query.hit), key=lambda query: -query.iou)
    misses = sorted(
        (query for query in ordered if not query.hit), key=lambda query: (query.iou, -query.relevancy)
    )
    best = _first_of_each(hits)[:count]
    shown = {query.category for query in best}
    return best, _first_of_each(query for query in misses if query.category not in shown)[:count]


def _first_of_each(queries: Iterable[ScoredQuery]) -> list[ScoredQuery]:
    first: dict[str, ScoredQuery] = {}
    for query in queries:
        first.setdefault(query.category, query)
    return [*first.values()]


def evaluation_of(scene: Scene, held_out: str = "corrected") -> Evaluation:
    """Read the evaluation frames of a scene that was opened with its annotations, see ``read_evaluation``."""
    return read_evaluation(*(scene.artifact(one.name) for one in SCORED[:4]), held_out=held_out)


def ask_again(
    chosen: Sequence[ScoredQuery], scene: Scene, document: Mapping[str, Any], path: Path
) -> Iterator[ShownQuery]:
    """Answer the ``chosen`` queries again as in the stage ``metrics``, frame by frame; ``document`` is the metrics.json at ``path``.

    Raises:
        UserError: the scene was scored with other artifacts, or the OpenCLIP model that made the features is missing.
    """
    check_inputs(path, document["provenance"]["inputs"], scene.given)
    if not chosen:
        return
    options = recorded_options(document["provenance"]["options"])
    evaluation = evaluation_of(scene, options.held_out)
    asked = {(query.frame, query.category): query for query in evaluation.find_queries(options)}
    shown = [asked[query.frame, query.category] for query in chosen]
    ask = ask_of(evaluation, scene.asker(phrases_to_ask(shown, evaluation.instances, options)), options.masks)
    for frame in sorted({query.frame for query in chosen}):
        in_frame = [query for query in chosen if query.frame == frame]
        photograph, second = scene.frames[frame], float(scene.seconds[frame])
        view = scene.render(pose=evaluation.camera_to_world[frame], second=second)
        answers = ask(frame, [query.category for query in in_frame])
        for query, answer in zip(in_frame, answers, strict=True):
            place = asked[frame, query.category]
            target = read_layers(evaluation.annotations, place.row, evaluation.valid), place.instances["all"]
            yield ShownQuery(query, photograph, view, mask_of(*target), bounding_boxes(*target), answer)


def summary(document: Mapping[str, Any]) -> str:
    """Scores of all queries with data and checkpoints; on the second line, a legend of the page."""
    score = document["scores"]["all"]
    about = f"origin {document['origin']}, {describe_models(document['models'])}"
    if not (count := score["count"]):
        return f"no queries; {about}"
    scores = []
    for key, name in (("accuracy", "accuracy"), ("mean_iou", "mIoU")):
        bounds = " to ".join(f"{100 * bound:.1f}" for bound in score[f"{key}_interval"] or ())
        interval = f" ({bounds})" if bounds else ""
        scores.append(f"{name} {100 * score[key]:.1f} %{interval}")
    chance = ", ".join(f"{name} {100 * score[key]:.1f} %" for key, name in CHANCE.items())
    return (
        f"{count} queries; {', '.join(scores)}; chance: {chance}; {about}\nAnnotated instances are white, their boxes dashed. "
        "Colors show relevancy from 0 (blue) to 1 (red). The marker is the most relevant pixel, green for a hit, red for a miss."
    )


def _draw_query(cells: NDArray[Any], query: ShownQuery) -> None:
    """Draw the photograph, the relevancy and the mask of a query."""
    photograph, heat, mask = cells
    scored, answer = query.scored, query.answer
    verdict, marker, color = HIT if scored.hit else MISS
    show(photograph, query.photograph, f'"{scored.category}", frame {scored.frame}')
    draw_heat(heat, query.view, answer.relevancy)
    heat.set_title(f"{verdict}, relevancy {scored.relevancy:.2f}", fontsize=9, color=color)
    draw_mask(mask, query.view, answer.mask)
    mask.set_title(f"mask: IoU {scored.iou:.2f}", fontsize=9)
    for axes in cells:
        draw_outline(axes, query.target)
    for axes, (x0, y0, x1, y1) in product((photograph, heat), query.boxes):
        box = (x0 - 0.5, y0 - 0.5), x1 - x0 + 1, y1 - y0 + 1
        axes.add_patch(Rectangle(*box, fill=False, edgecolor="white", linestyle="--", linewidth=0.9))
    if answer.pixel is not None:
        heat.scatter(*answer.pixel, s=110, marker=marker, color=color, edgecolors="white", linewidths=1.5)

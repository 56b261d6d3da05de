"""Answer scored queries of a scene again, to get the maps behind their scores."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.consistency import check_inputs
from egosplat.artifacts.lineage import open_histories
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import ANNOTATIONS, SPLATS
from egosplat.evaluation.evaluation_frames import Evaluation, read_evaluation
from egosplat.evaluation.options import MetricsOptions, recorded_options
from egosplat.evaluation.queries import find_queries, mask_of, phrases_to_ask, read_layers
from egosplat.evaluation.scored_scenes import ScoredScene
from egosplat.evaluation.scores import ask_of, bounding_boxes
from egosplat.query.answers import ViewMatch
from egosplat.query.finished_scene import Scene, open_artifacts, scene_of


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
    """A query with its (H, W, 3) uint8 photograph, float32 view in [0, 1], (H, W) bool target and ``bounding_boxes``."""

    scored: ScoredQuery
    photograph: NDArray[np.uint8]
    view: NDArray[np.float32]
    target: NDArray[np.bool_]
    boxes: NDArray[np.int64]
    answer: ViewMatch


def scored_queries(document: Mapping[str, Any]) -> list[ScoredQuery]:
    """All queries of a ``metrics.json``."""
    found = ((one, one["groups"]["all"]) for one in document["queries"])
    return [
        ScoredQuery(one["frame"], one["category"], one["relevancy"], score["hit"], score["iou"])
        for one, score in found
    ]


def best_and_worst(queries: Sequence[ScoredQuery], count: int) -> tuple[list[ScoredQuery], list[ScoredQuery]]:
    """Choose at most ``count`` best and ``count`` worst queries, each of a different category.

    The best ones hit; they are ordered by decreasing IoU. The worst ones miss, and their category is not among the best;
    they are ordered by increasing IoU, then by decreasing relevancy. Ties are ordered by frame and category.
    """
    found = sorted((one for one in queries if one.hit), key=lambda one: (-one.iou, one.frame, one.category))
    best = _one_a_category(found, ())[:count]
    missed = sorted(
        (one for one in queries if not one.hit),
        key=lambda one: (one.iou, -one.relevancy, one.frame, one.category),
    )
    return best, _one_a_category(missed, (one.category for one in best))[:count]


def _one_a_category(queries: Iterable[ScoredQuery], taken: Iterable[str]) -> list[ScoredQuery]:
    """The first query of each category outside ``taken``."""
    seen = set(taken)
    first: list[ScoredQuery] = []
    for one in queries:
        if one.category not in seen:
            seen.add(one.category)
            first.append(one)
    return first


def open_scored(folder: Path, options: MetricsOptions, *, in_time: bool = False) -> Scene:
    """Open a finished scene or variant with its annotations; ``in_time`` to ask frames at their own time, if they can be.

    Raises:
        UserError: as ``open_artifacts``, or the artifacts do not belong together.
    """
    frames, *others = open_artifacts(folder)
    annotations = open_artifact(frames.path.with_name("annotations.zarr"), ANNOTATIONS)
    splats = next(one for one in others if one.schema.name == SPLATS.name)
    histories = open_histories(folder, splats) if in_time else None
    more = [annotations] if histories is None else [annotations, histories]
    return scene_of([frames, *others, *more], options)


def evaluation_of(scene: Scene) -> Evaluation:
    """Read the evaluation frames of a scene that was opened with its annotations."""
    return read_evaluation(*map(scene.artifact, ("frames", "poses", "annotations", "splats")))


def is_in_time(scored: ScoredScene) -> bool:
    """Whether frames were asked at their own time."""
    return "histories.zarr" in scored.document["provenance"]["inputs"]


def scoring_options(scored: ScoredScene) -> MetricsOptions:
    """The options of the stage ``metrics`` that scored a scene, on any device."""
    recorded = recorded_options(scored.document["provenance"]["options"])
    return recorded.change(device="auto", backend="auto")


def ask_again(chosen: Sequence[ScoredQuery], scene: Scene, scored: ScoredScene) -> Iterator[ShownQuery]:
    """Answer queries again as in the stage ``metrics``, frame by frame.

    Args:
        chosen: queries of the scene.
        scene: the scored scene with its annotations and ``scoring_options``.

    Raises:
        UserError: the scene was scored with other artifacts, or the OpenCLIP model that made the features is missing.
    """
    check_inputs(scored.path, scored.document["provenance"]["inputs"], scene.given)
    if not chosen:
        return
    evaluation, options = evaluation_of(scene), scene.options
    assert isinstance(options, MetricsOptions)
    queries = find_queries(evaluation.annotations, evaluation.valid, options)
    asked = {(one.frame, one.category): one for one in queries}
    shown = [asked[one.frame, one.category] for one in chosen]
    asker = scene.asker(phrases_to_ask(shown, evaluation.instances, options))
    ask = ask_of(evaluation, asker, options.masks)
    for frame in sorted({one.frame for one in chosen}):
        in_frame = [one for one in chosen if one.frame == frame]
        photograph, view = scene.frames[frame], scene.render(frame)
        answers = ask(frame, [one.category for one in in_frame])
        for one, answer in zip(in_frame, answers, strict=True):
            query = asked[frame, one.category]
            layers = read_layers(evaluation.annotations, query.row, evaluation.valid)
            target = layers, query.instances["all"]
            yield ShownQuery(one, photograph, view, mask_of(*target), bounding_boxes(*target), answer)

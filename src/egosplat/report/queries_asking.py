"""Answer scored queries of a scene again, to get the maps behind their scores."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.annotations import ANNOTATIONS
from egosplat.artifacts.consistency import check_inputs
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.lineage import lineage
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.splats import SPLATS
from egosplat.errors import UserError
from egosplat.evaluation.evaluation_frames import Evaluation, read_evaluation
from egosplat.evaluation.localization import bounding_boxes
from egosplat.evaluation.queries import BenchmarkQueries, Query, find_queries
from egosplat.query.answer import Answer, Asker
from egosplat.query.options import QueryOptions
from egosplat.query.scene import read_scene
from egosplat.query.text import encode_texts, load_clip_of
from egosplat.report.queries_choice import ScoredQuery
from egosplat.tables.scored_scenes import ScoredScene

_SCHEMAS = (FRAMES, POSES, ANNOTATIONS, SPLATS, LANGUAGE)


@dataclass(frozen=True, eq=False)
class Sources:
    """The artifacts of a scored scene; ``encoded`` is its features, or the tiles that its codes were learnt from."""

    frames: Artifact
    poses: Artifact
    annotations: Artifact
    splats: Artifact
    language: Artifact
    encoded: Artifact


@dataclass(frozen=True, eq=False)
class ShownQuery:
    """A query with its images of (H, W) pixels.

    Attributes:
        scored: the query and its score.
        photograph: (H, W, 3) uint8.
        view: (H, W, 3) float32 in [0, 1], rendered.
        target: (H, W) bool pixels of the annotated instances.
        boxes: (B, 4) int64 boxes of the instances, see ``bounding_boxes``.
        answer: the answer with its maps.
    """

    scored: ScoredQuery
    photograph: NDArray[np.uint8]
    view: NDArray[np.float32]
    target: NDArray[np.bool_]
    boxes: NDArray[np.int64]
    answer: Answer


def open_sources(paths: Sequence[Path], encoded: Artifact, scored: ScoredScene) -> Sources:
    """Open frames, poses, annotations, splats and language, in this order.

    Raises:
        UserError: the artifacts do not belong together, or the scene was scored with others.
    """
    opened = [open_artifact(path, schema) for path, schema in zip(paths, _SCHEMAS, strict=True)]
    opened.append(encoded)
    lineage(opened)
    if scored.foreign:
        raise UserError(
            f"{scored.path}: holds the scores of {scored.method}; only egosplat's own queries can be answered again. "
            "Give the scene's metrics.json"
        )
    check_inputs(scored.path, scored.document["provenance"]["inputs"], opened)
    return Sources(*opened)


def ask_again(
    chosen: Sequence[ScoredQuery], sources: Sources, options: Mapping[str, Any]
) -> Iterator[ShownQuery]:
    """Answer queries again as in the stage ``metrics``, frame by frame, on any device.

    Args:
        chosen: queries of the scene.
        sources: artifacts of the scored scene.
        options: options of the stage ``metrics``, from ``metrics.json``.

    Raises:
        UserError: the OpenCLIP model that made the features is missing.
    """
    if not chosen:
        return
    evaluation = read_evaluation(sources.frames, sources.poses, sources.annotations, sources.splats)
    asked = {(one.frame, one.category): one for one in _asked(evaluation, options)}
    answering = query_options(options)
    model, checkpoint, precision = (options[key] for key in ("clip_model", "clip_checkpoint", "precision"))
    clip = load_clip_of(sources.encoded, model, checkpoint, "auto", precision)
    texts = encode_texts(clip, sorted({one.category for one in chosen}), answering.canonical)
    scene = read_scene(sources.splats, sources.language, sources.encoded, "auto")
    asker = Asker.of(scene, texts, answering)
    for frame in sorted({one.frame for one in chosen}):
        in_frame = [one for one in chosen if one.frame == frame]
        pose = evaluation.camera_to_world[frame]
        photograph, view = sources.frames.row("rgb", frame), scene.picture(evaluation.camera, pose)
        phrases = [one.category for one in in_frame]
        answers = asker.ask(phrases, evaluation.camera, pose, evaluation.valid)
        for scored, answer in zip(in_frame, answers, strict=True):
            target, boxes = _target(evaluation, asked[frame, scored.category])
            yield ShownQuery(scored, photograph, view, target, boxes, answer)


def query_options(options: Mapping[str, Any]) -> QueryOptions:
    """Select the query options from the options of the stage ``metrics``."""
    named = {field.name: options[field.name] for field in fields(QueryOptions)}
    return QueryOptions(**named | {"canonical": tuple(named["canonical"])})


def _asked(evaluation: Evaluation, options: Mapping[str, Any]) -> list[Query]:
    which = BenchmarkQueries(
        min_area=options["min_area"], excluded=tuple(options["excluded"]), people=options["people"]
    )
    return find_queries(evaluation.annotations, evaluation.valid, which)


def _target(evaluation: Evaluation, query: Query) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """The pixels and the boxes of all instances of a query."""
    frame = next(one for one in evaluation.frames if one.row == query.row)
    instance_map, instances = evaluation.map_of(frame), query.instances["all"]
    return np.isin(instance_map, instances), bounding_boxes(instance_map, instances)

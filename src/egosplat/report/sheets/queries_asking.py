"""Answer scored queries of a scene again, to get the maps behind their scores."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.annotations import ANNOTATIONS
from egosplat.artifacts.consistency import check_inputs
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.lineage import lineage
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.registry import SCHEMAS
from egosplat.artifacts.splats import SPLATS
from egosplat.errors import UserError
from egosplat.evaluation.evaluation_frames import Evaluation, read_evaluation
from egosplat.evaluation.localization import bounding_boxes
from egosplat.evaluation.options import MetricsOptions, recorded_options
from egosplat.evaluation.queries import Query, find_queries
from egosplat.evaluation.scored_scenes import ScoredScene
from egosplat.query.answer import Answer, Asker
from egosplat.query.scene import read_scene
from egosplat.query.sources import QuerySources, find_sources
from egosplat.query.text import encode_texts, load_clip_of
from egosplat.report.sheets.queries_choice import ScoredQuery

_SCHEMAS = (FRAMES, POSES, SPLATS, LANGUAGE, ANNOTATIONS)


@dataclass(frozen=True)
class ScoredSources(QuerySources):
    """The artifacts of a scored scene."""

    annotations: Artifact

    def evaluation(self) -> Evaluation:
        """Read the evaluation frames."""
        return read_evaluation(self.frames, self.poses, self.annotations, self.splats)


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


def open_sources(paths: Sequence[Path], encoded: Artifact) -> ScoredSources:
    """Open frames, poses, splats, language and annotations, in this order.

    Raises:
        UserError: the artifacts do not belong together.
    """
    *others, annotations = (open_artifact(path, schema) for path, schema in zip(paths, _SCHEMAS, strict=True))
    sources = ScoredSources(*others, encoded, annotations)
    lineage(list(vars(sources).values()))
    return sources


def open_finished(folder: Path) -> ScoredSources:
    """Open the artifacts of a finished scene or variant; raises as ``find_sources`` and ``open_sources``."""
    *paths, encoded = find_sources(folder)
    paths.append(paths[0].with_name("annotations.zarr"))
    return open_sources(paths, open_artifact(encoded, SCHEMAS[encoded.stem]))


def open_asker(sources: QuerySources, phrases: Iterable[str], options: MetricsOptions) -> Asker:
    """Read the scene, and encode phrases, each once.

    Raises:
        UserError: the OpenCLIP model that made the features is missing, or the backend cannot run.
    """
    clip = load_clip_of(
        sources.encoded, options.clip_model, options.clip_checkpoint, options.device, options.precision
    )
    texts = encode_texts(clip, sorted({*phrases}), options.canonical)
    scene = read_scene(sources.splats, sources.language, sources.encoded, options.backend)
    return Asker.of(scene, texts, options)


def ask_again(
    chosen: Sequence[ScoredQuery], sources: ScoredSources, scored: ScoredScene
) -> Iterator[ShownQuery]:
    """Answer queries again as in the stage ``metrics``, frame by frame, on any device.

    Args:
        chosen: queries of the scene.
        sources: artifacts of the scored scene.

    Raises:
        UserError: the scene was scored with other artifacts, or the OpenCLIP model that made the features is missing.
    """
    _check(sources, scored)
    if not chosen:
        return
    evaluation = sources.evaluation()
    recorded = recorded_options(scored.document["provenance"]["options"])
    options = recorded.change(device="auto", backend="auto")
    queries = find_queries(evaluation.annotations, evaluation.valid, options)
    asked = {(one.frame, one.category): one for one in queries}
    asker = open_asker(sources, [one.category for one in chosen], options)
    for frame in sorted({one.frame for one in chosen}):
        in_frame = [one for one in chosen if one.frame == frame]
        pose = evaluation.camera_to_world[frame]
        photograph, view = sources.frames.row("rgb", frame), asker.scene.picture(evaluation.camera, pose)
        phrases = [one.category for one in in_frame]
        answers = asker.ask(phrases, evaluation.camera, pose, evaluation.valid)
        for one, answer in zip(in_frame, answers, strict=True):
            target, boxes = _target(evaluation, asked[frame, one.category])
            yield ShownQuery(one, photograph, view, target, boxes, answer)


def _check(sources: ScoredSources, scored: ScoredScene) -> None:
    """Raise ``UserError`` if the scene was scored with other artifacts."""
    if scored.foreign:
        raise UserError(
            f"{scored.path}: holds the scores of {scored.method}; only egosplat's own queries can be answered again. "
            "Give the scene's metrics.json"
        )
    check_inputs(scored.path, scored.document["provenance"]["inputs"], list(vars(sources).values()))


def _target(evaluation: Evaluation, query: Query) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """The pixels and the boxes of all instances of a query."""
    frame = next(one for one in evaluation.frames if one.row == query.row)
    instance_map, instances = evaluation.map_of(frame), query.instances["all"]
    return np.isin(instance_map, instances), bounding_boxes(instance_map, instances)

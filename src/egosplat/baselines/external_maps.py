"""Stage ``method_metrics``: score the relevancy maps of another method.

Queries, reading of maps and scores are those of the stage ``metrics``. Renders are not scored, and Gaussians are not
counted.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from egosplat.alarms.artifact_alarms import alarms_of_all
from egosplat.artifacts import provenance
from egosplat.artifacts.annotations import ANNOTATIONS
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.lineage import lineage
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.relevancy import Relevancy, open_relevancy
from egosplat.baselines.options import MethodMetricsOptions
from egosplat.errors import UserError
from egosplat.evaluation.document import answer_entries, provenance_entries, write_metrics
from egosplat.evaluation.evaluation_frames import count_frames, find_asked_queries, find_frames
from egosplat.evaluation.intervals import RESAMPLING
from egosplat.evaluation.queries import Mask, Query, instances_of, phrases_to_ask
from egosplat.evaluation.run_queries import CLASSES, mask_classes, run_queries
from egosplat.progress import log
from egosplat.query.answer import ViewAnswer
from egosplat.query.maps import Found, find_in_maps

_UNKNOWN_COST = {"wall_s": None, "peak_memory_mb": None}


def run(
    frames_path: Path,
    poses_path: Path,
    annotations_path: Path,
    relevancy_path: Path,
    output: Path,
    options: MethodMetricsOptions,
    *,
    title: str,
    preset: str | None = None,
    world_seed: int | None = None,
    camera: str | None = None,
) -> None:
    """Write another method's scores of a scene as JSON, see ``metrics.schema.yaml``.

    Args:
        relevancy_path: maps in the layout of ``egosplat.artifacts.relevancy``; maps of other queries are ignored.
        title: ``DATASET/SCENE``.
        preset, world_seed, camera: as in ``provenance_entries``.

    Raises:
        UserError: the inputs do not match, a query has no map, or a map does not follow the layout.
    """
    frames, poses = open_artifact(frames_path, FRAMES), open_artifact(poses_path, POSES)
    annotations, maps = open_artifact(annotations_path, ANNOTATIONS), open_relevancy(relevancy_path)
    made_from = lineage([frames, poses, annotations])
    record = provenance.begin_from(
        "method_metrics", options.as_dict() | asdict(RESAMPLING), [*made_from.found.values(), maps.artifact]
    )
    valid = frames.read("valid")
    _check_size(maps, valid)
    evaluated = find_frames(frames, poses, annotations, rendered={})
    queries = find_asked_queries(annotations, valid, options, evaluated)
    instances = instances_of(annotations)
    classes = phrases_to_ask(queries, instances, options) if options.masks == CLASSES else None
    _check_complete(maps, queries, classes)

    def ask(frame: int, phrases: Sequence[str]) -> Iterator[ViewAnswer]:
        found = (find_in_maps(maps.maps(frame, phrase), valid, options) for phrase in phrases)
        return (_answer(phrase, one, valid) for phrase, one in zip(phrases, found, strict=True))

    asked = mask_classes(ask, classes) if classes else ask
    answered = list(run_queries(queries, asked, annotations, valid, options))
    no_renders = [{} for _ in evaluated]
    document = {
        "method": maps.method,
        "scene": title,
        "notice": None,
        "alarms": [asdict(alarm) for alarm in alarms_of_all(made_from.found.values())],
        "counts": count_frames(frames, evaluated, instances),
        **answer_entries(answered, evaluated, no_renders, instances, maps.levels, valid, options.masks),
        **provenance_entries(record, made_from, None, preset, world_seed, camera, _UNKNOWN_COST),
    }
    write_metrics(output, document)
    log(f"{maps.method}: {len(answered)} queries; {len(maps.rows) - len(answered)} maps belong to no query")


def _check_size(maps: Relevancy, valid: Mask) -> None:
    (height, width), (rows, columns) = valid.shape, maps.size
    # The aspect ratio is that of the frames, up to rounding of the resized width and height.
    if abs(rows * width - columns * height) > max(width, height):
        raise UserError(
            f"{maps.path}: maps of {columns}x{rows} pixels have another aspect ratio than the frames, "
            f"{width}x{height}; give maps of whole frames, at any size"
        )


def _check_complete(maps: Relevancy, queries: Sequence[Query], classes: Sequence[str] | None) -> None:
    # A query without a map would not be scored, instead of counting as a miss.
    needed = dict.fromkeys((one.frame, phrase) for one in queries for phrase in classes or [one.category])
    if missing := [one for one in needed if one not in maps.rows]:
        frame, category = missing[0]
        raise UserError(
            f"{maps.path}: has no map for {len(missing)} of {len(needed)} queries, the first {category!r} in "
            f"frame {frame}.\nGive a map for each query; a map of NaN means that nothing is visible"
        )


def _answer(phrase: str, found: Found | None, valid: Mask) -> ViewAnswer:
    if found is None:
        nothing = np.zeros(valid.shape, np.float32)
        return ViewAnswer(phrase, 0.0, None, None, None, nothing, None, nothing > 0)
    at, mask = found.location, found.segmentation
    return ViewAnswer(phrase, at.score, at.level, at.pixel, None, found.relevancy, mask.level, mask.mask)

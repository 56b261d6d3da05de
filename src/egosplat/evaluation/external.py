"""Stage ``method_metrics``: another method's relevancy maps are scored like egosplat's own.

The queries are those of the stage ``metrics``, their maps are read by the same code, and the scores are written in the
same form, but for what only egosplat's artifacts tell: no renders are scored, and there are no counts of Gaussians.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from egosplat.alarms.artifact_alarms import alarms_of_all
from egosplat.artifacts import provenance
from egosplat.artifacts.annotations import ANNOTATIONS
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.lineage import lineage
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.provenance import Provenance
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.relevancy import Relevancy, open_relevancy
from egosplat.errors import UserError
from egosplat.evaluation.document import (
    FORMAT_VERSION,
    METHOD_METRICS,
    frame_entry,
    query_entry,
    score_entry,
    write_metrics,
)
from egosplat.evaluation.evaluation_frames import Frame
from egosplat.evaluation.intervals import IntervalOptions
from egosplat.evaluation.provenance_summary import artifact_entries
from egosplat.evaluation.queries import (
    BenchmarkQueries,
    InstanceMap,
    Mask,
    Query,
    find_queries,
    instances_of,
    read_map,
)
from egosplat.evaluation.rendering import summarise_rendering
from egosplat.evaluation.run_queries import Asked
from egosplat.evaluation.scores import score_query, summarise
from egosplat.output_files import check_output
from egosplat.progress import log, track
from egosplat.query.maps import Found, find_in_maps
from egosplat.query.options import LANGSPLAT, QueryOptions

UNDECIDED = 0.01
"""Share of a picture; where more of it has the largest relevancy, a hit says little."""


@dataclass(frozen=True)
class MethodMetricsOptions(BenchmarkQueries, IntervalOptions):
    """The schema's keys of ``metrics``, and of ``query`` those that matter for maps of another method.

    ``config.schema.yaml`` describes each.
    """

    hit_region: str
    box_filter: float
    segmentation_threshold: float
    majority_filter: float

    @property
    def query(self) -> QueryOptions:
        """How the maps are read."""
        return replace(
            LANGSPLAT,
            box_filter=self.box_filter,
            segmentation_threshold=self.segmentation_threshold,
            majority_filter=self.majority_filter,
        )


def run(
    frames: Path,
    poses: Path,
    annotations: Path,
    relevancy: Path,
    output: Path,
    options: MethodMetricsOptions,
    *,
    title: str,
) -> None:
    """Write another method's scores of a scene as JSON, see ``metrics.schema.yaml``.

    Args:
        frames, poses, annotations: the scene's artifacts; frames without a pose are not asked, as in ``metrics``.
        relevancy: the maps, laid out as in ``egosplat.artifacts.relevancy``; those of other queries are not read.
        output: the file.
        title: ``DATASET/SCENE``.

    Raises:
        UserError: inputs do not belong together, a query has no map, or a map is not what the layout says.
    """
    check_output(output, METHOD_METRICS)
    pictures, walk = open_artifact(frames, FRAMES), open_artifact(poses, POSES)
    truth, maps = open_artifact(annotations, ANNOTATIONS), open_relevancy(relevancy)
    made_from = lineage([pictures, walk, truth])
    made = _begin(asdict(options), made_from.found.values(), maps)
    valid = pictures.read("valid")
    _check_size(maps, valid)
    seen = _frames(pictures, walk, truth)
    queries = _queries(truth, valid, options, seen)
    _check_complete(maps, queries)
    asked = list(_ask(queries, truth, maps, valid, options.query, options.hit_region))
    scores = summarise([one.score for one in asked], options)
    instances = instances_of(truth)
    document = {
        "format_version": FORMAT_VERSION,
        "method": maps.method,
        "scene": title,
        "origin": made.origin,
        "notice": None,
        "alarms": [asdict(alarm) for alarm in alarms_of_all(made_from.found.values())],
        "counts": _counts(pictures, seen, len(instances)),
        "scores": {name: score_entry(score) for name, score in scores.items()},
        "queries": [query_entry(one, instances, maps.levels) for one in asked],
        "frames": [frame_entry(frame, _asked_in(frame, asked), {}) for frame in seen],
        "rendering": {name: asdict(score) for name, score in summarise_rendering([]).items()},
        "models": {},
        "artifacts": artifact_entries(made_from),
        "total": {"wall_s": None, "peak_memory_mb": None},
        "provenance": made.record(),
    }
    write_metrics(output, document, METHOD_METRICS)
    log(f"{maps.method}: {len(asked)} queries; {len(maps.rows) - len(asked)} maps are of no query")


def _begin(keys: dict[str, Any], artifacts: Sequence[Artifact], maps: Relevancy) -> Provenance:
    inputs = {artifact.path.name: artifact.digest for artifact in artifacts} | {maps.path.name: maps.digest}
    origin = provenance.joint_origin(*(artifact.origin for artifact in artifacts))
    return provenance.begin("method_metrics", keys, origin, inputs)


def _check_size(maps: Relevancy, valid: Mask) -> None:
    (height, width), (rows, columns) = valid.shape, maps.size
    # The picture resized: the same shape, but for what rounding takes.
    if abs(rows * width - columns * height) > max(width, height):
        raise UserError(
            f"{maps.path}: maps of {columns}x{rows} pixels are of another shape than the frames, {width}x{height}; "
            "give whole frames, of any size"
        )


def _frames(pictures: Artifact, walk: Artifact, truth: Artifact) -> list[Frame]:
    train, registered = pictures.read("train"), walk.read("registered")
    index, annotated = truth.read("frame").tolist(), truth.read("annotated").tolist()
    return [
        Frame(row, frame, annotated[row], bool(registered[frame]), bool(train[frame]), None)
        for row, frame in enumerate(index)
    ]


def _queries(truth: Artifact, valid: Mask, options: BenchmarkQueries, frames: Sequence[Frame]) -> list[Query]:
    """Those of frames that have a pose."""
    asked = {frame.row for frame in frames if frame.asked}
    return [query for query in find_queries(truth, valid, options) if query.row in asked]


def _check_complete(maps: Relevancy, queries: Sequence[Query]) -> None:
    """A query left out would not count as a miss."""
    lacking = [query for query in queries if (query.frame, query.category) not in maps.rows]
    if lacking:
        first = lacking[0]
        raise UserError(
            f"{maps.path}: has no map for {len(lacking)} of {len(queries)} queries, the first {first.category!r} in "
            f"frame {first.frame}.\nGive all; a map of NaN says that nothing is seen"
        )


def _ask(
    queries: Sequence[Query],
    truth: Artifact,
    maps: Relevancy,
    valid: Mask,
    options: QueryOptions,
    hit_region: str,
) -> Iterator[Asked]:
    undecided = 0
    for row, own in groupby(track(queries, "reading maps", unit="query"), key=lambda query: query.row):
        instance_map = read_map(truth, row, valid)
        for query in own:
            found = find_in_maps(maps.maps(query.frame, query.category), valid, options)
            undecided += found is not None and len(found.location.candidates) > UNDECIDED * valid.size
            yield _asked(query, found, instance_map, valid, hit_region)
    if undecided:
        log(
            f"warning: in {undecided} of {len(queries)} queries more than {UNDECIDED:.0%} of the picture has the "
            "largest relevancy, and any of its pixels may hit"
        )


def _asked(
    query: Query, found: Found | None, instance_map: InstanceMap, valid: Mask, hit_region: str
) -> Asked:
    candidates = np.zeros((0, 2), np.int64) if found is None else found.location.candidates
    mask = np.zeros_like(valid) if found is None else found.segmentation.mask
    return Asked(
        query=query,
        score=score_query(query, candidates, mask, instance_map, valid, hit_region),
        relevancy=0.0 if found is None else found.location.score,
        level=None if found is None else found.location.level,
        pixel=None if found is None else found.location.pixel,
        position=None,
        mask_level=None if found is None else found.segmentation.level,
        mask_pixels=int(mask.sum()),
    )


def _counts(pictures: Artifact, frames: Sequence[Frame], instances: int) -> dict[str, int]:
    return {
        "frames": pictures.shape("rgb")[0],
        "evaluation_frames": len(frames),
        "evaluation_frames_annotated": sum(frame.annotated for frame in frames),
        "evaluation_frames_asked": sum(frame.asked for frame in frames),
        "evaluation_frames_trained_on": sum(frame.trained_on for frame in frames),
        "evaluation_frames_without_pose": sum(not frame.registered for frame in frames),
        "annotated_instances": instances,
    }


def _asked_in(frame: Frame, asked: Sequence[Asked]) -> int:
    return sum(one.query.frame == frame.index for one in asked)

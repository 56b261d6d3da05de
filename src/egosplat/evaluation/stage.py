"""Stage ``metrics``: everything that is annotated is asked for; answers and renders are scored."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from egosplat.alarms.alarm import Alarm, warning_lines
from egosplat.alarms.artifact_alarms import alarms_of_all
from egosplat.alarms.scene import metrics_alarms
from egosplat.artifacts import provenance
from egosplat.artifacts.annotations import ANNOTATIONS
from egosplat.artifacts.features import FEATURES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.lineage import Lineage, lineage
from egosplat.artifacts.poses import POSES, length_unit
from egosplat.artifacts.provenance import Provenance
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.splats import SPLATS
from egosplat.evaluation.counts import counts_of
from egosplat.evaluation.document import (
    FORMAT_VERSION,
    METRICS,
    frame_entry,
    query_entry,
    score_entry,
    write_metrics,
)
from egosplat.evaluation.evaluation_frames import Evaluation, Frame, read_evaluation
from egosplat.evaluation.intervals import IntervalOptions
from egosplat.evaluation.presence import ask_presence, presence_entry, presence_phrases
from egosplat.evaluation.provenance_summary import artifact_entries, models_used, total_cost
from egosplat.evaluation.queries import GROUPS, BenchmarkQueries, Query, find_queries
from egosplat.evaluation.rendering import summarise_rendering
from egosplat.evaluation.run_queries import Asked, ask_all
from egosplat.evaluation.scores import GroupScore, summarise
from egosplat.models.suitability import notice_of_artifacts
from egosplat.output_files import check_output
from egosplat.progress import log
from egosplat.query.clip import load_clip_of
from egosplat.query.options import QueryOptions
from egosplat.query.scene import read_scene
from egosplat.query.text import encode_texts


@dataclass(frozen=True)
class MetricsOptions(QueryOptions, BenchmarkQueries, IntervalOptions):
    """The schema's keys of ``metrics``, ``query`` and ``presence``, and of ``models`` OpenCLIP's.

    ``config.schema.yaml`` describes each.
    """

    backend: str
    hit_region: str
    negatives: tuple[str, ...]
    clip_model: str
    clip_checkpoint: str
    device: str
    precision: str


def run(
    frames: Path,
    poses: Path,
    annotations: Path,
    features: Path,
    splats: Path,
    language: Path,
    output: Path,
    options: MetricsOptions,
    *,
    title: str,
) -> None:
    """Write the scores of a scene as JSON, see ``metrics.schema.yaml``.

    Raises:
        UserError: inputs do not belong together, the model is not that of the features, the backend cannot run.
    """
    check_output(output, METRICS)
    pictures, walk = open_artifact(frames, FRAMES), open_artifact(poses, POSES)
    truth, words = open_artifact(annotations, ANNOTATIONS), open_artifact(features, FEATURES)
    trained, meaning = open_artifact(splats, SPLATS), open_artifact(language, LANGUAGE)
    made_from = lineage([pictures, walk, truth, words, trained, meaning])
    made = _begin(asdict(options), made_from)
    model = (options.clip_model, options.clip_checkpoint, options.device, options.precision)
    clip = load_clip_of(words, *model)
    evaluation = read_evaluation(pictures, walk, truth, trained)
    queries = _queries(evaluation, options)
    texts = encode_texts(clip, sorted({query.category for query in queries}), options.canonical)
    scene = read_scene(trained, meaning, words, options.backend)
    asked = list(ask_all(queries, evaluation, scene, texts, options, options.hit_region))
    phrases = presence_phrases(queries, evaluation.instances, options.negatives)
    presence = presence_entry(
        ask_presence(*phrases, evaluation, walk, scene, clip, options), options.min_score
    )
    scores = summarise([one.score for one in asked], options)
    used = list(made_from.found.values())
    notice, alarms = notice_of_artifacts(used), [*alarms_of_all(used), *_alarms(scores["all"])]
    document = {
        "scene": title,
        "notice": notice,
        "alarms": [asdict(alarm) for alarm in alarms],
        "counts": counts_of(evaluation, words, meaning, made_from),
        "scores": {name: score_entry(score) for name, score in scores.items()},
        "presence": presence,
        "length_unit": length_unit(walk),
        "queries": [query_entry(one, evaluation.instances, meaning.facts["levels"]) for one in asked],
        **_rendering(evaluation, asked),
        **_making(made, made_from),
    }
    write_metrics(output, document, METRICS)
    _tell(evaluation.frames, scores)
    _tell_presence(presence)
    for line in warning_lines(notice, alarms):
        log(line)


def _begin(keys: dict[str, Any], made_from: Lineage) -> Provenance:
    found = made_from.found
    origin = provenance.joint_origin(*(artifact.origin for artifact in found.values()))
    inputs = {name: artifact.digest for name, artifact in found.items()}
    models = {key: used["hash"] for key, used in models_used(made_from).items() if key in keys}
    return provenance.begin("metrics", keys, origin, inputs, models)


def _queries(evaluation: Evaluation, options: BenchmarkQueries) -> list[Query]:
    """Those of frames that have a pose."""
    asked = {frame.row for frame in evaluation.frames if frame.asked}
    found = find_queries(evaluation.annotations, evaluation.valid, options)
    return [query for query in found if query.row in asked]


def _rendering(evaluation: Evaluation, asked: Sequence[Asked]) -> dict[str, Any]:
    rendering = [evaluation.rendering_of(frame) for frame in evaluation.frames]
    counts = [sum(one.query.frame == frame.index for one in asked) for frame in evaluation.frames]
    entries = zip(evaluation.frames, counts, rendering, strict=True)
    return {
        "frames": [frame_entry(*entry) for entry in entries],
        "rendering": {name: asdict(score) for name, score in summarise_rendering(rendering).items()},
    }


def _making(made: Provenance, made_from: Lineage) -> dict[str, Any]:
    record = made.record()
    return {
        "format_version": FORMAT_VERSION,
        "origin": made.origin,
        "provenance": record,
        "models": models_used(made_from),
        "artifacts": artifact_entries(made_from),
        "total": total_cost(made_from, record),
    }


def _alarms(score: GroupScore) -> Iterator[Alarm]:
    interval = score.accuracy_interval
    return metrics_alarms(interval and interval.low, max(score.random_pixel, score.middle_pixel))


def _tell(frames: Sequence[Frame], scores: Mapping[str, GroupScore]) -> None:
    if trained_on := sum(frame.trained_on for frame in frames):
        log(
            f"warning: {trained_on} of {len(frames)} evaluation frames were trained on; their renders are not scored"
        )
    if lost := sum(frame.annotated and not frame.registered for frame in frames):
        log(f"warning: {lost} annotated frames have no pose and are not asked")
    for name in GROUPS:
        one = scores[name]
        told = (
            f"accuracy {one.accuracy:.1%} (chance: a random pixel {one.random_pixel:.1%}, the middle of the picture "
            f"{one.middle_pixel:.1%}), mIoU {one.mean_iou:.1%}"
        )
        log(f"{name}: {one.count} queries, {told if one.count else 'nothing to ask for'}")


def _tell_presence(presence: Mapping[str, Any]) -> None:
    present, absent = presence["present"], presence["absent"]
    if present["asked"]:
        log(
            f"whole scene: of {present['asked']} things that are there {present['answered']} are answered, "
            f"{present['right']} of them rightly"
        )
    if absent["asked"]:
        log(f"whole scene: of {absent['asked']} things that are not there {absent['answered']} are answered")

"""Stage ``metrics``: query every annotated category, score the answers and the renders."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from egosplat.alarms.artifact_alarms import alarms_of, find_chance_alarm, warning_lines
from egosplat.artifacts import provenance
from egosplat.artifacts.lineage import Lineage, open_inputs
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import FEATURES, MASKS, length_unit
from egosplat.evaluation.document import answer_entries, finite, models_used, provenance_entries
from egosplat.evaluation.evaluation_frames import (
    SCORED,
    Evaluation,
    Frame,
    RegionScore,
    read_evaluation,
    summarise_rendering,
)
from egosplat.evaluation.intervals import CONFIDENCE, RESAMPLES, SEED
from egosplat.evaluation.options import MetricsOptions
from egosplat.evaluation.presence import ask_presence, presence_entry, presence_phrases
from egosplat.evaluation.queries import GROUPS, phrases_to_ask
from egosplat.evaluation.scores import ask_of, run_queries
from egosplat.gaussians.evaluation import develop
from egosplat.gaussians.io import read_exposure
from egosplat.models.suitability import notice_of_artifacts
from egosplat.pipeline.validation import write_document
from egosplat.progress import log
from egosplat.query.finished_scene import Scene, scene_of


def run(
    *,
    output: Path,
    options: MetricsOptions,
    title: str,
    method: str | None = None,
    preset: str | None = None,
    world_seed: int | None = None,
    camera: str | None = None,
    **paths: Path | None,
) -> None:
    """Write the scores of a scene as JSON, see ``metrics.schema.yaml``; with histories each frame is asked and rendered at its
    own time.

    ``method`` is the published one that the codes stand for, None for EgoSplat; features or tiles are what they were learnt
    from. A synthetic apartment has a seed and a camera. UserError: inputs do not match, another model made them, or the backend
    cannot run.
    """
    artifacts = open_inputs(paths)
    frames, poses, annotations, splats, language = (artifacts[schema.name] for schema in SCORED)
    if language.facts.get("maps_only"):
        options = options.change(readout="pixels")
    scene = scene_of(artifacts.values(), options)
    made_from, used, encoded = scene.made_from, list(scene.made_from.found.values()), scene.encoded
    keys = options.as_dict() | {"confidence": CONFIDENCE, "resamples": RESAMPLES, "seed": SEED}
    models = {key: model["hash"] for key, model in models_used(made_from).items() if key in keys}
    record = provenance.begin_from("metrics", keys, used, models)
    evaluation = read_evaluation(frames, poses, annotations, splats, options.held_out)
    queries = evaluation.find_queries(options)
    asker = scene.asker(phrases_to_ask(queries, evaluation.instances, options))
    ask = ask_of(evaluation, asker, options.masks)
    answered = list(run_queries(queries, ask, annotations, evaluation.valid, options))
    phrases = presence_phrases(queries, evaluation.instances, options.negatives)
    presence = presence_entry(ask_presence(*phrases, evaluation, scene), options.min_score)
    without_time = [*map(evaluation.rendering_of, evaluation.frames)]
    rendering = list(_scores_in_time(evaluation, scene, without_time))
    answers = answer_entries(answered, evaluation, rendering, options.masks)
    overall = answers["scores"]["all"]
    notice, alarms = notice_of_artifacts(used), [*alarms_of(*used), *find_chance_alarm(overall)]
    document = {
        "scene": title,
        **({} if method is None else {"method": method}),
        "stands_in": language.facts.get("stands_in", []),
        "notice": notice,
        "alarms": [asdict(alarm) for alarm in alarms],
        "counts": _counts(evaluation, encoded, language, made_from),
        "presence": presence,
        "length_unit": length_unit(poses),
        **answers,
        **provenance_entries(record, made_from, preset=preset, world_seed=world_seed, camera=camera),
    }
    if splats.has("held_out/render_given"):
        own = replace(evaluation, renders="held_out/render_given")
        document["rendering_without_corrections"] = summarise_rendering([*map(own.rendering_of, own.frames)])
    if scene.rests is not None:
        document["rendering_without_time"] = summarise_rendering(without_time)
    write_document(output, finite(document), "metrics")
    for line in (*_score_lines(evaluation.frames, document), *warning_lines(notice, alarms)):
        log(line)


def _scores_in_time(
    evaluation: Evaluation, scene: Scene, without_time: Sequence[Mapping[str, RegionScore]]
) -> Iterator[Mapping[str, RegionScore]]:
    """Scores of each frame's render at its own time (docs/method.md#own-time); where nothing rests then, those without time."""
    given = evaluation.renders.endswith("given")
    log_gains, compression = (None, None) if given else read_exposure(evaluation.splats)
    for frame, score in zip(evaluation.frames, without_time, strict=True):
        second = None if frame.held_out is None else float(scene.seconds[frame.index])
        if (now := scene.trained.at(scene.rests, second)) is not scene.trained:
            log_gain = None if log_gains is None else log_gains[frame.index]
            pose = evaluation.camera_to_world[frame.index]
            picture = develop(now, now.camera, pose, log_gain, compression)
            score = evaluation.rendering_of(frame, picture.cpu().numpy())
        yield score


def _counts(
    evaluation: Evaluation, encoded: Artifact, language: Artifact, made_from: Lineage
) -> dict[str, Any]:
    """Counts of frames, Gaussians, and of instances and their views where codes were learnt from them."""
    # Without masks, the lineage has no masks artifact.
    masks = [artifact for artifact in made_from.found.values() if artifact.schema.name == MASKS.name]
    frames, with_code = evaluation.frames, (language.read("share") > 0).sum(axis=0)
    counts = {
        "frames": evaluation.frames_artifact.shape("rgb")[0],
        "evaluation_frames": len(frames),
        "evaluation_frames_annotated": sum(frame.annotated for frame in frames),
        "evaluation_frames_asked": sum(frame.asked for frame in frames),
        "evaluation_frames_trained_on": sum(frame.trained_on for frame in frames),
        "evaluation_frames_without_pose": sum(not frame.registered for frame in frames),
        "annotated_instances": len(evaluation.instances),
        "training_frames": evaluation.splats.facts["views"]["training"],
        "transient_instances": masks[0].facts["transient"] if masks else None,
        "gaussians": evaluation.splats.shape("means")[0],
        "gaussians_with_code": dict(zip(language.facts["levels"], with_code.tolist(), strict=True)),
        "code_channels": language.shape("code")[2],
    }
    if encoded.schema.name == FEATURES.name:
        levels = encoded.facts["levels"]
        by_level = np.bincount(encoded.read("instances/level"), minlength=len(levels))
        counts["instances"] = dict(zip(levels, by_level.tolist(), strict=True))
        counts["views"] = encoded.shape("instance")[0]
    return counts


def _score_lines(frames: Sequence[Frame], document: Mapping[str, Any]) -> Iterator[str]:
    if trained_on := sum(frame.trained_on for frame in frames):
        yield f"warning: {trained_on} of {len(frames)} evaluation frames are training frames; their renders are not scored"
    if lost := sum(frame.annotated and not frame.registered for frame in frames):
        yield f"warning: {lost} annotated frames have no pose and are not queried"
    for name in GROUPS:
        score = document["scores"][name]
        values = (
            f"accuracy {score['accuracy']:.1%} (chance: a random pixel {score['random_pixel']:.1%}, the middle of the image "
            f"{score['middle_pixel']:.1%}), mIoU {score['mean_iou']:.1%}"
        )
        yield f"{name}: {score['count']} queries, {values if score['count'] else 'no scores'}"
    if document.get("pixel_accuracy") is not None:
        yield f"pixels with the right class: {document['pixel_accuracy']:.1%}"
    present, absent = document["presence"]["present"], document["presence"]["absent"]
    if present["asked"]:
        yield (
            f"whole scene: of {present['asked']} present things {present['answered']} are found, {present['right']} of them "
            f"rightly, and {present['guessed']} guessed, {present['guessed_right']} rightly"
        )
    if absent["asked"]:
        yield f"whole scene: of {absent['asked']} absent things {absent['answered']} are found, {absent['guessed']} guessed"

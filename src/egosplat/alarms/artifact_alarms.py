"""Compute the alarms of artifacts from their facts and arrays, and log them."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from egosplat.alarms.alarm import Alarm, warning_lines
from egosplat.alarms.instances import features_alarms, instances_alarms, segments_alarms, view_features_alarms
from egosplat.alarms.recording import frames_alarms, poses_alarms
from egosplat.alarms.scene import (
    corrections_alarms,
    language_alarms,
    masks_alarms,
    splats_alarms,
    transient_alarms,
)
from egosplat.artifacts.masks import BY_INSTANCES, BY_NETWORK
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.registry import SCHEMAS
from egosplat.models.suitability import notice_of_artifacts
from egosplat.pipeline.stages import STAGES
from egosplat.progress import log


def alarms_of(artifact: Artifact) -> list[Alarm]:
    """The alarms of one artifact; empty for a kind without alarms."""
    return list(_BY_KIND.get(artifact.schema.name, _none)(artifact))


def alarms_of_all(artifacts: Iterable[Artifact]) -> list[Alarm]:
    """The alarms of several artifacts, in the order of the stages."""
    order = list(STAGES)
    ordered = sorted(artifacts, key=lambda one: order.index(one.provenance["stage"]))
    return [alarm for artifact in ordered for alarm in alarms_of(artifact)]


def warnings_of(*artifacts: Artifact) -> list[str]:
    """The ``warning_lines`` of artifacts."""
    return warning_lines(notice_of_artifacts(artifacts), alarms_of_all(artifacts))


def log_warnings(stage: str, output: Path) -> None:
    """Log the ``warning_lines`` of a stage's artifact; nothing if the stage writes no artifact."""
    if stage in SCHEMAS:
        for line in warnings_of(open_artifact(output, SCHEMAS[stage])):
            log(line)


def _none(artifact: Artifact) -> Iterable[Alarm]:
    return ()


def _frames(frames: Artifact) -> Iterable[Alarm]:
    blurred, count = frames.facts.get("blurred_frames"), frames.shape("rgb")[0]
    share = None if blurred is None else blurred / count
    return frames_alarms(float(frames.read("valid").mean()), share)


def _poses(poses: Artifact) -> Iterable[Alarm]:
    notes = poses.facts.get("notes", {})
    registered = float(poses.read("registered").mean())
    figures = notes.get("reprojection_error_px"), notes.get("models", []), notes.get("parallax_deg")
    return poses_alarms(registered, *figures)


def _segments(segments: Artifact) -> Iterable[Alarm]:
    facts = segments.facts
    names = ("pixels_without_instance", "instances_per_frame", "frames_per_instance")
    return segments_alarms(*(facts.get(name) for name in names))


def _instances(instances: Artifact) -> Iterable[Alarm]:
    counts = instances.facts.get("merging")
    if counts is None:
        return ()
    merged = instances.read("instances/masks")[~instances.read("instances/moving")]
    masks = sum(level["masks"] for level in counts.values())
    return instances_alarms(int(merged.sum()), masks, instances.facts.get("pixels_without_instance"))


def _view_features(views: Artifact) -> Iterable[Alarm]:
    return view_features_alarms(views.facts.get("without_feature", 0), views.shape("instance")[0])


def _features(features: Artifact) -> Iterable[Alarm]:
    facts = features.facts
    return features_alarms(
        outliers=facts.get("outliers", 0),
        views=features.shape("instance")[0],
        agreement=facts.get("agreement"),
        spread=facts.get("spread", {}).get("features"),
        reconstruction=facts.get("reconstruction", {}).get("mean"),
    )


def _transient(transient: Artifact) -> Iterable[Alarm]:
    return transient_alarms(transient.facts.get("mean_probability"))


def _masks(masks: Artifact) -> Iterable[Alarm]:
    moving = masks.read("instances/transient")
    return masks_alarms(
        int(moving.sum()), len(moving), masks.facts.get("masked_share"), _withheld(masks.facts)
    )


def _withheld(facts: Mapping[str, Any]) -> str | None:
    if facts.get("withheld") == BY_NETWORK:
        return f"the network's mean probability is {facts['mean_probability']:.2f}"
    if facts.get("withheld") == BY_INSTANCES:
        return f"{facts['withheld_instances']} of {facts['seen']} instances look transient"
    return None


def _splats(splats: Artifact) -> Iterable[Alarm]:
    yield from splats_alarms(splats.read("held_out/psnr"))
    if splats.has("corrections/shift"):
        shift = np.linalg.norm(splats.read("corrections/shift"), axis=1)
        gain, depth = splats.read("corrections/gain"), splats.facts["scene_depth"]
        yield from corrections_alarms(shift, splats.read("corrections/turn"), gain, depth)


def _language(language: Artifact) -> Iterable[Alarm]:
    share = language.read("share")
    return language_alarms(float((share <= 0).all(axis=1).mean()) if len(share) else None)


_BY_KIND: dict[str, Callable[[Artifact], Iterable[Alarm]]] = {
    "frames": _frames,
    "poses": _poses,
    "segments": _segments,
    "instances": _instances,
    "view_features": _view_features,
    "features": _features,
    "transient": _transient,
    "masks": _masks,
    "splats": _splats,
    "language": _language,
}

"""Compute the alarms of artifacts from their facts and arrays, and log them."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from egosplat.alarms.limits import CAUSES, CAUSING_KEYS, LIMITS, Alarm, find_alarm
from egosplat.alarms.texts import warning_lines
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.registry import SCHEMAS
from egosplat.models.suitability import notice_of_artifacts
from egosplat.pipeline.config import section_keys
from egosplat.pipeline.stages import STAGES
from egosplat.progress import log


def alarms_of(artifact: Artifact) -> list[Alarm]:
    """The alarms of one artifact; empty for a kind without alarms."""
    find = _BY_KIND.get(artifact.schema.name)
    return [] if find is None else [_with_causes(alarm, artifact) for alarm in find(artifact)]


def _with_causes(alarm: Alarm, artifact: Artifact) -> Alarm:
    """Add the keys that may have caused an alarm, with their values, if these are not the defaults."""
    given = artifact.provenance["options"]
    found = []
    for key in CAUSING_KEYS.get(alarm.key, ()):
        section, _, name = key.partition(".")
        if name in given and given[name] != section_keys(section)[name]["default"]:
            found.append(f"{key} {given[name]}")
    return replace(alarm, figures={**alarm.figures, CAUSES: ", ".join(found)}) if found else alarm


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


def _share(part: float, whole: int) -> float | None:
    return part / whole if whole else None


def _check_frames(frames: Artifact) -> Iterator[Alarm]:
    yield from find_alarm("frames.valid_pixels", float(frames.read("valid").mean()))
    blurred = frames.facts.get("blurred_frames")
    share = None if blurred is None else _share(blurred, frames.shape("rgb")[0])
    yield from find_alarm("frames.blurred", share)


def _check_poses(poses: Artifact) -> Iterator[Alarm]:
    notes = poses.facts.get("notes", {})
    models = notes.get("models", [])
    yield from find_alarm("poses.registered", float(poses.read("registered").mean()))
    yield from find_alarm("poses.reprojection", notes.get("reprojection_error_px"))
    yield from find_alarm("poses.parallax", notes.get("parallax_deg"))
    # A device's own points, and a file of poses without any, are no structure from motion.
    points = notes.get("points", 0) if "parallax_deg" in notes else 0
    per_frame = _share(points, int(poses.read("registered").sum())) if points else None
    yield from find_alarm("poses.points", per_frame, points=points)
    yield from find_alarm("poses.models", len(models), frames=", ".join(map(str, models)))


def _check_segments(segments: Artifact) -> Iterator[Alarm]:
    yield from find_alarm("segments.empty_pixels", segments.facts.get("pixels_without_instance"))
    for name in ("instances_per_frame", "frames_per_instance"):
        yield from find_alarm(f"segments.{name}", segments.facts.get(name))


def _check_instances(instances: Artifact) -> Iterator[Alarm]:
    counts = instances.facts.get("merging")
    if counts is None:  # tracks
        return
    kept = int(instances.read("instances/masks")[~instances.read("instances/moving")].sum())
    masks = sum(level["masks"] for level in counts.values())
    yield from find_alarm("instances.masks_kept", _share(kept, masks), kept=kept, masks=masks)
    yield from find_alarm("instances.empty_pixels", instances.facts.get("pixels_without_instance"))


def _check_view_features(features: Artifact) -> Iterator[Alarm]:
    lost = features.facts.get("without_feature", 0)
    views = lost + features.shape("instance")[0]
    yield from find_alarm("view_features.lost", _share(lost, views), lost=lost, views=views)


def _check_features(features: Artifact) -> Iterator[Alarm]:
    facts = features.facts
    outliers, views = facts.get("outliers", 0), features.shape("instance")[0]
    yield from find_alarm("features.outliers", _share(outliers, views), outliers=outliers, views=views)
    cosine, spread = facts.get("agreement"), facts.get("spread", {}).get("features")
    if cosine is not None and spread is not None:
        agreement = agreement_of(cosine, spread)
        yield from find_alarm("features.agreement", agreement, cosine=cosine, spread=spread)
    yield from find_alarm("features.reconstruction", facts.get("reconstruction", {}).get("mean"))


def agreement_of(cosine: float, spread: float) -> float:
    """Mean cosine of views with their instance's feature, from 0, as instances with each other (``spread``), to 1."""
    return (cosine - spread) / (1.0 - spread) if spread < 1.0 else 1.0


def _check_transient(transient: Artifact) -> Iterator[Alarm]:
    yield from find_alarm("transient.probability", transient.facts.get("mean_probability"))


def _check_masks(masks: Artifact) -> Iterator[Alarm]:
    facts, moving = masks.facts, masks.read("instances/transient")
    if facts.get("withheld"):
        figures = {"transient": facts["withheld_instances"], "instances": facts["seen"]}
        yield Alarm("masks.withheld", {"probability": facts["mean_probability"], **figures})
    count, transient = len(moving), int(moving.sum())
    yield from find_alarm("masks.instances", _share(transient, count), transient=transient, instances=count)
    yield from find_alarm("masks.pixels", facts.get("masked_share"))


def _check_splats(splats: Artifact) -> Iterator[Alarm]:
    psnr = splats.read("held_out/psnr")
    yield from find_alarm("splats.psnr", float(psnr.mean()) if len(psnr) else None)
    if splats.has("corrections/shift"):
        yield from _check_pose_corrections(splats)
        yield from _check_gains(splats)


def _check_pose_corrections(splats: Artifact) -> Iterator[Alarm]:
    shift, turn = np.linalg.norm(splats.read("corrections/shift"), axis=1), splats.read("corrections/turn")
    depth = splats.facts["scene_depth"]
    if not len(shift):
        return
    # Frames without a pose have no correction.
    angle = np.nan_to_num(np.maximum(shift / depth, np.radians(turn)), posinf=np.inf)
    most = int(angle.argmax())
    yield from find_alarm(
        "splats.pose_correction",
        angle[most],
        **_passed("splats.pose_correction", angle),
        frame=most,
        shift_mm=1e3 * float(shift[most]),
        turn_deg=float(turn[most]),
        depth_m=float(depth),
    )


def _check_gains(splats: Artifact) -> Iterator[Alarm]:
    gain = splats.read("corrections/gain")
    if not len(gain):
        return
    factor = np.exp(np.abs(np.log(np.maximum(np.nan_to_num(gain, nan=1.0), 1e-9)))).max(axis=1)
    most = int(factor.argmax())
    colors = dict(zip(("red", "green", "blue"), map(float, gain[most]), strict=True))
    yield from find_alarm("splats.gain", factor[most], **_passed("splats.gain", factor), frame=most, **colors)


def _passed(key: str, statistics: np.ndarray) -> dict[str, int]:
    """The number of frames beyond a limit, and of all frames."""
    return {"wrong": int((statistics > LIMITS[key].value).sum()), "frames": len(statistics)}


def _check_language(language: Artifact) -> Iterator[Alarm]:
    share = language.read("share")
    without = float((share <= 0).all(axis=1).mean()) if len(share) else None
    yield from find_alarm("language.without_code", without)


_BY_KIND: dict[str, Callable[[Artifact], Iterator[Alarm]]] = {
    "frames": _check_frames,
    "poses": _check_poses,
    "segments": _check_segments,
    "instances": _check_instances,
    "view_features": _check_view_features,
    "features": _check_features,
    "transient": _check_transient,
    "masks": _check_masks,
    "splats": _check_splats,
    "language": _check_language,
}

"""Stage ``survey``: decide from frames and poses whether anything moves, which frames are blurred, and which add views."""

from pathlib import Path
from typing import Any

import numpy as np

from egosplat.artifacts import provenance
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES, shown_pixels
from egosplat.files import write_json
from egosplat.geometry import Array, Camera
from egosplat.pipeline.survey_file import Survey, digest_of_frames
from egosplat.pipeline.validation import Draft202012Validator, schema
from egosplat.progress import log
from egosplat.survey import decisions
from egosplat.survey.motion import Motion, measure_motion
from egosplat.survey.options import SurveyOptions
from egosplat.survey.sharpness import Sharpness, Views, find_blurred, measure_all
from egosplat.survey.views import Bools, choose_views, median_depths

FORMAT_VERSION = 5


def run(frames_path: Path, poses_path: Path, output: Path, options: SurveyOptions) -> None:
    """Write the survey of ``frames`` with ``poses`` (UserError: the poses are not of these frames)."""
    frames, poses = open_artifact(frames_path, FRAMES), open_artifact(poses_path, POSES)
    check_made_from(poses, frames, axes=("frame",))
    record = provenance.begin_from("survey", options.as_dict(), (frames, poses))
    motion = measure_motion(frames, poses)
    views = _geometry(frames, poses)
    optional = frames.read("train") & ~frames.read("evaluation")
    sharpness = find_blurred(measure_all(frames), views, frames.read("train"), optional, options.blur_limit)
    document = {
        "format_version": FORMAT_VERSION,
        "origin": record.origin,
        "motion": _motion(motion, options.min_moving_share),
        "camera": _camera(motion),
        "sharpness": _sharpness(sharpness, options.blur_limit),
        "views": _views(frames, poses, views.depths, sharpness, optional, options.min_view_change_deg),
        "poses": _poses(frames, poses),
        "provenance": record.record(),
    }
    write_survey(output, document)
    _log_summary(document)


def _motion(motion: Motion, min_share: float) -> dict[str, Any]:
    share = decisions.moving_share(motion.share, motion.fleeting)
    columns = (motion.moving, motion.lasting, motion.voting, motion.noise_px, motion.stops)
    names = ("moving", "lasting", "voting", "noise_px", "stops")
    rows = zip(motion.pairs.tolist(), zip(*columns, strict=True), strict=True)
    return {
        "static": decisions.is_static(share),
        "masking": "refined" if decisions.needs_masks(share, min_share) else "none",
        "share": decisions.finite(share),
        "min_share": min_share,
        "fleeting": decisions.finite(motion.fleeting),
        "voting": decisions.finite(motion.voting.mean()) if len(motion.pairs) else None,
        "noise_px": decisions.finite(_median(motion.noise_px)),
        "pairs": [
            {"frames": pair} | dict(zip(names, map(decisions.finite, row), strict=True)) for pair, row in rows
        ],
    }


def _camera(motion: Motion) -> dict[str, Any]:
    residual, stops = decisions.pose_residual(motion), decisions.brightness_range(motion)
    return {
        "pose_residual_px": None if residual is None else decisions.finite(residual.explained_px),
        "pose_noise_px": None if residual is None else decisions.finite(residual.noise_px),
        "revisits": len(motion.revisits),
        "refine_poses": decisions.refines_poses(residual),
        "brightness_stops": decisions.finite(stops),
        "compensate_exposure": decisions.compensates_exposure(stops),
    }


def _geometry(frames: Artifact, poses: Artifact) -> Views:
    _, height, width, _ = frames.shape("rgb")
    camera = Camera.from_matrix(poses.read("intrinsics"), width, height)
    camera_to_world, registered = poses.read("camera_to_world"), poses.read("registered")
    depths = median_depths(camera, camera_to_world, registered, poses.read("points/xyz"))
    valid = frames.read("valid")
    return Views(camera, camera_to_world, depths, lambda frame: shown_pixels(frames, frame, valid))


def _sharpness(found: Sharpness, blur_limit: float) -> dict[str, Any]:
    return {
        "values": [float(value) if np.isfinite(value) else None for value in found.values],
        "scatter": found.scatter,
        "blur_limit": blur_limit,
        "min_difference": found.min_difference,
        "dropped": [{"frame": frame, "sharper": others} for frame, others in found.replaced_by.items()],
    }


def _views(
    frames: Artifact, poses: Artifact, depths: Array, sharpness: Sharpness, optional: Bools, least_deg: float
) -> dict[str, Any]:
    sharp = np.ones(len(depths), bool)
    sharp[list(sharpness.replaced_by)] = False
    times_ns, registered = frames.read("timestamp_ns"), poses.read("registered")
    # Among the frames that remain, so that a view is not left to a blurred frame.
    kept = sharp & choose_views(
        poses.read("camera_to_world"), depths, times_ns, registered, optional & sharp, least_deg
    )
    kept_frames = np.flatnonzero(kept)
    return {
        "kept": kept_frames.tolist(),
        "left_out": np.flatnonzero(~kept).tolist(),
        "min_view_change_deg": least_deg,
        "median_depth_m": _median(depths),
        "digest": digest_of_frames(kept_frames),
    }


def _median(values: Array) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


def _poses(frames: Artifact, poses: Artifact) -> dict[str, Any]:
    has_device = frames.facts["device_from_camera"] is not None
    from_device = has_device and poses.provenance["options"]["method"] != "colmap"
    return {
        "source": "device" if from_device else poses.facts.get("notes", {}).get("source", "colmap"),
        "registered": int(poses.read("registered").sum()),
        "frames": frames.shape("rgb")[0],
        "points": poses.shape("points/xyz")[0],
    }


def _log_summary(document: dict[str, Any]) -> None:
    motion, camera, views = document["motion"], document["camera"], document["views"]
    if motion["share"] is None:
        log("motion: cannot be told; masked, so that nothing that moves is trained on")
    else:
        verdict = "nothing moves" if motion["static"] else f"{motion['share']:.3%} of the picture moves"
        log(f"motion: {verdict}; {'masked' if motion['masking'] != 'none' else 'too little to be masked'}")
    wanted = {
        "poses are refined": camera["refine_poses"],
        "exposure is compensated": camera["compensate_exposure"],
    }
    log(f"camera: {', '.join(name for name, needed in wanted.items() if needed) or 'needs no correction'}")
    blurred = len(document["sharpness"]["dropped"])
    log(
        f"views: {len(views['kept'])} frames kept, {len(views['left_out']) - blurred} dropped for too small a view "
        f"change, {blurred} because sharper frames show the same"
    )


def write_survey(output: Path, document: Survey) -> None:
    """Check a survey against its schema (jsonschema.ValidationError) and write it with sorted keys, whole or not at all."""
    Draft202012Validator(schema("survey")).validate(document)
    write_json(output, document)

"""Stage ``survey``: decide from frames and poses whether anything moves, which frames are blurred, and which add views."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts import provenance
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.geometry import Camera
from egosplat.output_files import check_output
from egosplat.pipeline.survey_file import FORMAT_VERSION, SURVEY, digest_of_frames, write_survey
from egosplat.progress import log
from egosplat.survey.brightness import exposure_curve, exposure_range
from egosplat.survey.motion import Motion, is_static, measure_motion
from egosplat.survey.sharpness import Sharpness, Views, find_blurred, measure_all
from egosplat.survey.views import choose_views, median_depths

# Poses that fit the flow worse are refined [px of an image of 256]; brightness that changes more is compensated [stops].
_MAX_POSE_RESIDUAL_PX, _MAX_BRIGHTNESS_STOPS = 0.5, 0.3


@dataclass(frozen=True)
class SurveyOptions:
    """The schema's keys of ``survey``; ``config.schema.yaml`` describes each."""

    max_moving_share: float
    min_view_change_deg: float
    blur_limit: float


def run(frames_path: Path, poses_path: Path, output: Path, options: SurveyOptions) -> None:
    """Write the survey of ``frames`` with ``poses``.

    Raises:
        UserError: the poses are not of these frames.
    """
    check_output(output, SURVEY)
    frames, poses = open_artifact(frames_path, FRAMES), open_artifact(poses_path, POSES)
    check_made_from(poses, frames, axes=("frame",))
    record = provenance.begin_from("survey", asdict(options), (frames, poses))
    motion = measure_motion(frames, poses)
    views = _geometry(frames, poses)
    sharpness = _find_blurred(frames, views, options.blur_limit)
    document = {
        "format_version": FORMAT_VERSION,
        "origin": record.origin,
        "motion": _motion(motion, options.max_moving_share),
        "camera": _camera(motion),
        "sharpness": _sharpness(sharpness, options.blur_limit),
        "views": _views(frames, poses, views.depths, sharpness, options.min_view_change_deg),
        "poses": _poses(frames, poses),
        "provenance": record.record(),
    }
    write_survey(output, document)
    _log_summary(document)


def _motion(motion: Motion, threshold: float) -> dict[str, Any]:
    static = is_static(motion, threshold)
    rows = zip(motion.pairs.tolist(), motion.moving.tolist(), motion.measured.tolist(), strict=True)
    return {
        "static": static,
        "masking": "none" if static else "refined",
        "probability": _probability(motion.share, threshold),
        "share": motion.share,
        "threshold": threshold,
        "measured": float(motion.measured.mean()) if len(motion.pairs) else None,
        "pairs": [
            {"frames": pair, "moving": moving, "measured": measured} for pair, moving, measured in rows
        ],
    }


def _probability(share: float | None, threshold: float) -> float | None:
    """Probability that something moves: 0.5 at the threshold, 0.999 at three times of it."""
    if share is None:
        return None
    return 1.0 / (1.0 + (threshold / share) ** 6) if share > 0 else 0.0


def _camera(motion: Motion) -> dict[str, Any]:
    """Decide whether poses are refined and exposure is compensated. What is not measured asks for neither."""
    known = motion.residual_px[np.isfinite(motion.residual_px)]
    residual_px = float(np.median(known)) if len(known) else None
    stops = exposure_range(exposure_curve(motion.pairs, motion.stops))
    return {
        "pose_residual_px": residual_px,
        "refine_poses": residual_px is not None and residual_px > _MAX_POSE_RESIDUAL_PX,
        "brightness_stops": stops,
        "compensate_exposure": stops is not None and stops > _MAX_BRIGHTNESS_STOPS,
    }


def _geometry(frames: Artifact, poses: Artifact) -> Views:
    _, height, width, _ = frames.shape("rgb")
    camera = Camera.from_matrix(poses.read("intrinsics"), width, height)
    camera_to_world, registered = poses.read("camera_to_world"), poses.read("registered")
    depths = median_depths(camera, camera_to_world, registered, poses.read("points/xyz"))
    return Views(camera, frames.read("valid"), camera_to_world, depths)


def _optional(frames: Artifact) -> NDArray[np.bool_]:
    """(F,) bool: the frames that training may leave out."""
    return frames.read("train") & ~frames.read("evaluation")


def _find_blurred(frames: Artifact, views: Views, blur_limit: float) -> Sharpness:
    values = measure_all(frames)
    return find_blurred(values, views, frames.read("train"), _optional(frames), blur_limit)


def _sharpness(found: Sharpness, blur_limit: float) -> dict[str, Any]:
    return {
        "values": [float(value) if np.isfinite(value) else None for value in found.values],
        "scatter": found.scatter,
        "blur_limit": blur_limit,
        "min_difference": found.min_difference,
        "dropped": [{"frame": frame, "sharper": others} for frame, others in found.replaced_by.items()],
    }


def _views(
    frames: Artifact,
    poses: Artifact,
    depths: NDArray[np.float64],
    sharpness: Sharpness,
    min_change_deg: float,
) -> dict[str, Any]:
    sharp = np.ones(len(depths), bool)
    sharp[list(sharpness.replaced_by)] = False
    # Among the frames that remain, so that a view is not left to a blurred frame.
    kept = sharp & choose_views(
        poses.read("camera_to_world"),
        depths,
        frames.read("timestamp_ns"),
        poses.read("registered"),
        _optional(frames) & sharp,
        min_change_deg,
    )
    kept_frames = np.flatnonzero(kept)
    return {
        "kept": kept_frames.tolist(),
        "left_out": np.flatnonzero(~kept).tolist(),
        "min_view_change_deg": min_change_deg,
        "median_depth_m": _median(depths),
        "digest": digest_of_frames(kept_frames),
    }


def _median(depths: NDArray[np.float64]) -> float | None:
    known = depths[np.isfinite(depths)]
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
    motion, views = document["motion"], document["views"]
    if motion["share"] is None:
        log("motion: too little is measured to decide; treated as moving")
    else:
        verdict = "nothing moves" if motion["static"] else "something moves"
        log(f"motion: {verdict}; {motion['share']:.3%} of the pixels, threshold {motion['threshold']:.3%}")
    blurred = len(document["sharpness"]["dropped"])
    log(
        f"views: {len(views['kept'])} frames kept, {len(views['left_out']) - blurred} dropped for too small a view "
        f"change, {blurred} because sharper frames show the same"
    )

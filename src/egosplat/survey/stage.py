"""Stage ``survey``: what a scene requires, decided by its frames and poses alone."""

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
from egosplat.survey.moving import Motion, is_static, measure_motion
from egosplat.survey.views import choose_views, median_depths


@dataclass(frozen=True)
class SurveyOptions:
    """The schema's keys of ``survey``; ``config.schema.yaml`` describes each."""

    max_moving_share: float
    min_view_change_deg: float


def run(frames: Path, poses: Path, output: Path, options: SurveyOptions) -> None:
    """Write the survey of ``frames`` with ``poses``.

    Raises:
        UserError: the inputs do not belong together.
    """
    check_output(output, SURVEY)
    pictures, walk = open_artifact(frames, FRAMES), open_artifact(poses, POSES)
    check_made_from(walk, pictures, axes=("frame",))
    made = provenance.begin_from("survey", asdict(options), (pictures, walk))
    document = {
        "format_version": FORMAT_VERSION,
        "origin": made.origin,
        "motion": _motion(measure_motion(pictures, walk), options.max_moving_share),
        "views": _views(pictures, walk, options.min_view_change_deg),
        "poses": _poses(pictures, walk),
        "provenance": made.record(),
    }
    write_survey(output, document)
    _tell(document)


def _motion(found: Motion, threshold: float) -> dict[str, Any]:
    static = is_static(found, threshold)
    rows = zip(found.pairs.tolist(), found.moving.tolist(), found.measured.tolist(), strict=True)
    return {
        "static": static,
        "masking": "none" if static else "refined",
        "share": found.share,
        "threshold": threshold,
        "measured": float(found.measured.mean()) if len(found.pairs) else None,
        "pairs": [{"frames": pair, "moving": moving, "measured": part} for pair, moving, part in rows],
    }


def _views(pictures: Artifact, walk: Artifact, least_deg: float) -> dict[str, Any]:
    _, height, width, _ = pictures.shape("rgb")
    camera = Camera.from_matrix(walk.read("intrinsics"), width, height)
    camera_to_world, registered = walk.read("camera_to_world"), walk.read("registered")
    depths = median_depths(camera, camera_to_world, registered, walk.read("points/xyz"))
    optional = pictures.read("train") & ~pictures.read("evaluation")
    times = pictures.read("timestamp_ns")
    kept = choose_views(camera_to_world, depths, times, registered, optional, least_deg)
    stay = np.flatnonzero(kept)
    return {
        "kept": stay.tolist(),
        "left_out": np.flatnonzero(~kept).tolist(),
        "min_view_change_deg": least_deg,
        "median_depth_m": _median(depths),
        "digest": digest_of_frames(stay),
    }


def _median(depths: NDArray[np.float64]) -> float | None:
    known = depths[np.isfinite(depths)]
    return float(np.median(known)) if len(known) else None


def _poses(pictures: Artifact, walk: Artifact) -> dict[str, Any]:
    by_device = pictures.facts["device_from_camera"] is not None
    known = by_device and walk.provenance["options"]["method"] != "colmap"
    return {
        "source": "device" if known else "colmap",
        "registered": int(walk.read("registered").sum()),
        "frames": pictures.shape("rgb")[0],
        "points": walk.shape("points/xyz")[0],
    }


def _tell(document: dict[str, Any]) -> None:
    motion, views = document["motion"], document["views"]
    if motion["share"] is None:
        log("motion: too little could be measured to say; something is taken to move")
    else:
        verdict = "nothing moves" if motion["static"] else "something moves"
        log(f"motion: {verdict}; {motion['share']:.3%} of the pixels, threshold {motion['threshold']:.3%}")
    log(f"views: {len(views['kept'])} frames stay, {len(views['left_out'])} add too little to the one before")

"""Stage ``survey``: decide from frames and poses whether anything moves, and which frames add views."""

from pathlib import Path
from typing import Any

import numpy as np

from egosplat.arrays import Array
from egosplat.artifacts import provenance
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES
from egosplat.pipeline.survey_file import digest_of
from egosplat.pipeline.validation import write_document
from egosplat.progress import log
from egosplat.survey.cells import find_cells
from egosplat.survey.decisions import decide_camera, decide_motion, median
from egosplat.survey.motion import measure_motion
from egosplat.survey.options import SurveyOptions
from egosplat.survey.views import choose_views

FORMAT_VERSION = 8


def run(frames_path: Path, poses_path: Path, output: Path, options: SurveyOptions) -> None:
    """Write the survey of ``frames`` with ``poses`` (UserError: the poses are not of these frames)."""
    frames, poses = open_artifact(frames_path, FRAMES), open_artifact(poses_path, POSES)
    check_made_from(poses, frames, axes=("frame",))
    record = provenance.begin_from("survey", options.as_dict(), (frames, poses))
    motion, source = measure_motion(frames, poses), poses.facts.get("notes", {}).get("source", "colmap")
    if frames.facts["device_from_camera"] is not None and poses.provenance["options"]["method"] != "colmap":
        source = "device"
    document = {
        "format_version": FORMAT_VERSION,
        "origin": record.origin,
        "motion": decide_motion(motion, options.min_moving_share),
        "camera": decide_camera(motion),
        **_views(frames, poses, motion.depths, options),
        "poses": {
            "source": source,
            "registered": int(poses.read("registered").sum()),
            "frames": frames.shape("rgb")[0],
            "points": poses.shape("points/xyz")[0],
        },
        "provenance": record.record(),
    }
    write_document(output, document, "survey")
    camera, views = document["camera"], document["views"]
    log(f"motion: {document['motion']['verdict']}")
    refined, compensated = camera["refine_poses"], camera["compensate_exposure"]
    wanted = ["poses are refined"] * refined + ["exposure is compensated"] * compensated
    log(f"camera: {', '.join(wanted) or 'needs no correction'}")
    log(f"views: {len(views['kept'])} frames kept, {len(views['left_out'])} dropped: too small a view change")
    if cells := document["cells"]:
        log(f"cells: of {', '.join(str(len(cell['frames'])) for cell in cells)} training frames")


def _views(frames: Artifact, poses: Artifact, depths: Array, options: SurveyOptions) -> dict[str, Any]:
    """The sections ``views`` and ``cells``, by the (F,) median ``depths`` of the frames [m]."""
    train, registered = frames.read("train"), poses.read("registered")
    camera_to_world = poses.read("camera_to_world")
    times_ns, optional = frames.read("timestamp_ns"), train & ~frames.read("evaluation")
    kept = choose_views(camera_to_world, depths, times_ns, optional, options.min_view_change_deg)
    kept_frames, usable = np.flatnonzero(kept).tolist(), train & registered
    views = {
        "kept": kept_frames,
        "left_out": np.flatnonzero(~kept).tolist(),
        "min_view_change_deg": options.min_view_change_deg,
        "median_depth_m": median(depths),
        "digest": digest_of(kept_frames),
    }
    ground = camera_to_world, depths, usable, usable & kept, poses.read("up")
    return {"views": views, "cells": find_cells(*ground, options.cell_views)}

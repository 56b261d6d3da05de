"""Stage ``poses``: camera poses of the frames and points of the scene, from the device, a file or COLMAP."""

from pathlib import Path

import numpy as np

from egosplat.arrays import Ints
from egosplat.artifacts import provenance
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES, shown_pixels
from egosplat.artifacts.writer import create
from egosplat.calibration.files import poses_source
from egosplat.errors import UserError
from egosplat.geometry import Camera
from egosplat.pipeline.stages import load_module
from egosplat.poses.options import PosesOptions
from egosplat.poses.points import Views, add_points
from egosplat.poses.result import Poses
from egosplat.progress import log


def run(recording_path: Path, frames_path: Path, output: Path, options: PosesOptions) -> None:
    """Write the poses artifact of ``frames``; UserError if the trajectory is missing or damaged, or COLMAP fails."""
    frames = open_artifact(frames_path, FRAMES)
    has_device, kind = frames.facts["device_from_camera"] is not None, frames.facts.get("known_poses")
    source = poses_source(options.method, has_device, kind is not None)
    if options.meters_per_unit is not None and source != "known":
        only = "only known poses have a unit (docs/recordings.md)"
        raise UserError(f"poses.meters_per_unit: {only}; remove the key")
    record = provenance.begin_from("poses", options.as_dict(), [frames], chosen=source)
    poses = _find_poses(source, recording_path, frames, options)
    if source != "colmap" and not len(poses.points):
        log(f"{recording_path.name}: its poses come without points, which are triangulated")
        views = _views(frames, np.flatnonzero(poses.registered))
        poses = add_points(poses, views, options, opengl=kind == "transforms")
    log(f"{poses.registered.sum()} of {len(poses.registered)} frames have a pose; {len(poses.points)} points")
    with create(output, POSES, record) as artifact:
        artifact.put("camera_to_world", poses.camera_to_world)
        artifact.put("registered", poses.registered)
        artifact.put("intrinsics", poses.camera.matrix)
        artifact.put("up", poses.up)
        artifact.put("points/xyz", poses.points)
        artifact.put("points/rgb", poses.point_rgb)
        artifact.facts = {"notes": poses.notes | {"points": len(poses.points)}}


def _find_poses(source: str, recording: Path, frames: Artifact, options: PosesOptions) -> Poses:
    facts, module = frames.facts, load_module("poses", source)
    camera = Camera(**facts["camera"])
    if source == "device":
        device = np.asarray(facts["device_from_camera"], dtype=np.float64)
        return module.adt_poses(recording, frames.read("exposure_middle_ns"), device, camera, options)
    if source == "known":
        return module.known_poses(recording, facts, options)
    views, keys = _views(frames, np.arange(frames.shape("rgb")[0])), frames.provenance["options"]
    return module.colmap_poses(views, camera, facts["camera_known"], options, frame_keys=keys)


def _views(frames: Artifact, chosen: Ints) -> Views:
    valid = frames.read("valid")
    shown = (shown_pixels(frames, index, valid) for index in chosen) if frames.has("masked") else None
    return (frames.row("rgb", index) for index in chosen), valid, shown

"""Stage ``poses``: camera poses of the frames and points of the scene, from the device, a file or COLMAP."""

from pathlib import Path

import numpy as np

from egosplat.artifacts import provenance
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES, shown_pixels
from egosplat.artifacts.writer import create
from egosplat.calibration.files import KNOWN_POSES, poses_source
from egosplat.errors import UserError
from egosplat.geometry import Camera
from egosplat.pipeline.stages import load_module
from egosplat.poses.options import PosesOptions
from egosplat.poses.result import Poses
from egosplat.progress import log


def run(recording_path: Path, frames_path: Path, output: Path, options: PosesOptions) -> None:
    """Write the poses artifact of ``frames``; UserError if the trajectory is missing or damaged, or COLMAP fails."""
    frames, name = open_artifact(frames_path, FRAMES), recording_path.name
    has_device, kind = frames.facts["device_from_camera"] is not None, frames.facts.get("known_poses")
    if options.method == "device" and not has_device:
        raise UserError(f"poses.method = device: {name} has no device trajectory; use colmap or auto")
    if options.method == "known" and kind is None:
        raise UserError(
            f"poses.method = known: {name} has neither {' nor '.join(KNOWN_POSES.values())} "
            "(docs/recordings.md), or frames.known_poses is none"
        )
    source = poses_source(options.method, has_device, kind is not None)
    if options.meters_per_unit is not None and source != "known":
        only = "only known poses have a unit (docs/recordings.md)"
        raise UserError(f"poses.meters_per_unit: {only}; remove the key")
    record = provenance.begin_from("poses", options.as_dict(), [frames], chosen=source)
    poses = _find_poses(source, recording_path, frames, options)
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
    count, valid = frames.shape("rgb")[0], frames.read("valid")
    shown = (shown_pixels(frames, index, valid) for index in range(count)) if frames.has("masked") else None
    images = (frames.row("rgb", index) for index in range(count))
    about = {"shown": shown, "frame_keys": frames.provenance["options"]}
    return module.colmap_poses(images, valid, camera, facts["camera_known"], options, **about)

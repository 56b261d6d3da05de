"""Poses of an Aria Digital Twin (ADT) recording, from its MPS trajectory or its ground truth.

Both trajectories and the semi-dense points are in ADT's scene frame, so they need no alignment: ADT publishes the MPS
output already aligned with the ground truth ("ADT Data Format", Aligning Ground Truth and MPS Data).
"""

from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.geometry import Camera, is_rigid
from egosplat.poses.result import Poses, mean_camera_up, unregistered
from egosplat.poses.semidense import FILE_NAMES, GRAY, find_points, read_semidense_points
from egosplat.poses.trajectory import InterpolatedPoses, Trajectory, interpolate_trajectory, read_trajectory
from egosplat.progress import log

MPS_FOLDER = Path("mps") / "slam"
TRAJECTORIES = {
    "closed_loop": MPS_FOLDER / "closed_loop_trajectory.csv",
    "ground_truth": Path("aria_trajectory.csv"),
}

# A head looks down by less than this on average; beyond it, the frames are probably not upright.
MAX_TILT_DEG = 60.0


def adt_poses(
    folder: Path,
    exposure_middle_ns: NDArray[np.int64],
    device_from_camera: NDArray[np.float64],
    camera: Camera,
    *,
    trajectory: Literal["closed_loop", "ground_truth"],
    max_gap_ms: float,
    max_inv_dist_std: float = 0.001,
    max_dist_std: float = 0.15,
) -> Poses:
    """Interpolate the trajectory of an ADT recording at its frames, and read its points (docs/method.md#poses).

    ``camera_to_world = world_from_device(t) device_from_camera``. Frames outside the trajectory, or between rows too far
    apart, are not registered.

    Args:
        folder: the recording.
        exposure_middle_ns: (F,) int64 middle of each exposure, in the device's clock.
        device_from_camera: (4, 4) float64; camera axes are those of the (upright) frames.
        camera: of the frames.
        trajectory: ``closed_loop`` (SLAM of the glasses) or ``ground_truth`` (motion capture).
        max_gap_ms: frames between rows further apart than this get no pose. Ground truth has a row every 33.3 ms, a
            closed-loop trajectory one per millisecond.
        max_inv_dist_std, max_dist_std: limits of the points' uncertainty, see ``read_semidense_points``.

    Returns:
        Poses in ADT's scene frame [m], with gray points. A ground-truth recording without usable semi-dense points gets
        none, and a note.

    Raises:
        UserError: a file is missing or damaged, no frame lies within the trajectory, or (closed loop) no
            semi-dense point passes the filter.
    """
    if not is_rigid(device_from_camera):
        raise ValueError("device_from_camera is not a rigid motion")
    path = Path(folder) / TRAJECTORIES[trajectory]
    if not path.is_file():
        raise UserError(_missing_message(Path(folder), trajectory))
    rows = read_trajectory(path)
    # EgoLifter takes the nearest row instead.
    device = interpolate_trajectory(rows, exposure_middle_ns, max_gap_ms)
    if not device.known.any():
        raise UserError(_no_pose_message(rows, exposure_middle_ns, device, max_gap_ms))
    camera_to_world = unregistered(len(device.known))
    camera_to_world[device.known] = device.poses[device.known] @ device_from_camera
    points, point_notes = _points(Path(folder), trajectory == "closed_loop", max_inv_dist_std, max_dist_std)
    tilt = _angle_deg(rows.up, mean_camera_up(camera_to_world[device.known]))
    if tilt > MAX_TILT_DEG:
        log(f"{path}: up is {tilt:.0f} degrees from up in the frames: are the frames upright?")
    notes = {
        "trajectory": trajectory,
        "frames": len(device.known),
        "registered": int(device.known.sum()),
        "frames_outside_trajectory": device.outside,
        "frames_in_gaps": device.in_gaps,
        "largest_gap_bridged_ms": device.largest_gap_ms,
        "up_against_pictures_deg": tilt,
        "scale": "metres",
        **point_notes,
    }
    colours = np.full(points.shape, GRAY, np.uint8)
    return Poses(camera_to_world, device.known, camera, points, colours, rows.up, notes).check()


def _missing_message(folder: Path, trajectory: str) -> str:
    """The error of a missing trajectory; it advises the other one if that exists."""
    present = [name for name, path in TRAJECTORIES.items() if (folder / path).is_file()]
    advice = f", or set poses.trajectory={present[0]}, which is there" if present else ""
    others = [str(path) for name, path in TRAJECTORIES.items() if name != trajectory]
    missing = "" if present else f", and so is {', '.join(others)}"
    return f"{folder / TRAJECTORIES[trajectory]} is missing{missing}: download it{advice}"


def _angle_deg(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    # Accurate for small angles, unlike the arc cosine.
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)))


def _points(
    folder: Path, required: bool, max_inv_dist_std: float, max_dist_std: float
) -> tuple[NDArray[np.float64], dict[str, Any]]:
    """The semi-dense points and their notes; no points if they are missing and not required."""
    path = find_points(folder / MPS_FOLDER)
    if path is None:
        if required:
            raise UserError(
                f"{folder / MPS_FOLDER} has no {' or '.join(FILE_NAMES)}: download the MPS point cloud"
            )
        return np.empty((0, 3)), {"points": 0, "points_missing": "the recording has no semi-dense points"}
    cloud = read_semidense_points(path, max_inv_dist_std, max_dist_std)
    notes = {
        "points": len(cloud.points),
        "points_read": cloud.read,
        "points_rejected": cloud.rejected,
        "max_inv_dist_std": max_inv_dist_std,
        "max_dist_std": max_dist_std,
    }
    if len(cloud.points) == 0:
        if required:
            raise UserError(
                f"{path}: none of {cloud.read} points passes inv_dist_std < {max_inv_dist_std}"
                f" and dist_std < {max_dist_std}: raise poses.max_inv_dist_std or poses.max_dist_std"
            )
        notes["points_missing"] = "no semi-dense point passes the filter"
    return cloud.points, notes


def _no_pose_message(
    rows: Trajectory, frame_ns: NDArray[np.int64], device: InterpolatedPoses, max_gap_ms: float
) -> str:
    if len(frame_ns) == 0:
        return f"{rows.path}: there is no frame to find a pose for"
    if device.in_gaps:
        return (
            f"{rows.path}: every frame lies between rows more than {max_gap_ms:g} ms apart: raise "
            "poses.max_gap_ms"
        )
    first, last = (time * 1e-9 for time in (rows.timestamp_ns[0], rows.timestamp_ns[-1]))
    return (
        f"{rows.path} covers {first:.3f} s to {last:.3f} s, but the frames lie from"
        f" {frame_ns.min() * 1e-9:.3f} s to {frame_ns.max() * 1e-9:.3f} s: are both of the same recording?"
    )

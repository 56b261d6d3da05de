"""Poses of an Aria Digital Twin (ADT) recording, from its MPS trajectory or from its ground truth.

Both trajectories and the semi-dense points are in ADT's scene frame, the one in which its objects are placed:
ADT's documentation ("ADT Data Format", Aligning Ground Truth and MPS Data) says that the alignment of the MPS
output with the ground truth has been applied to the published closed-loop trajectory and semi-dense points.
So nothing is aligned here, and either trajectory may be combined with the points.
"""

from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.geometry import Camera, is_rigid
from egosplat.poses.result import Poses, mean_camera_up, unregistered
from egosplat.poses.semidense import FILE_NAMES, GRAY, find_points, read_semidense_points
from egosplat.poses.trajectory import Bridged, Trajectory, at_times, read_trajectory
from egosplat.progress import log

MPS_FOLDER = Path("mps") / "slam"
TRAJECTORIES = {
    "closed_loop": MPS_FOLDER / "closed_loop_trajectory.csv",
    "ground_truth": Path("aria_trajectory.csv"),
}

MOST_TILT_DEG = 60.0
"""A head looks down by less than this on average; beyond it, the pictures are likely not upright."""


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
    """Poses of the pictures of an ADT recording (docs/method.md#poses).

    ``camera_to_world = world_from_device(t) device_from_camera``. EgoLifter takes the row nearest in time;
    here the pose is interpolated between the two rows around t. A frame outside of the trajectory, or between
    rows too far apart, is not registered.

    Args:
        folder: of the recording.
        exposure_middle_ns: (F,) int64: when the middle of each picture was exposed, in the device's clock.
        device_from_camera: (4, 4) float64, to the axes of the (upright) pictures.
        camera: of the pictures; passed on.
        trajectory: ``closed_loop`` is what a wearer of the glasses would have, ``ground_truth`` is motion
            capture.
        max_gap_ms: rows further apart than this are not interpolated between. Ground truth has a row
            every 33.3 ms, closed-loop trajectories one a millisecond.
        max_inv_dist_std: semi-dense points above this uncertainty of the inverse distance are left out [1/m].
        max_dist_std: and those above this uncertainty of the distance [m].

    Returns:
        Poses in ADT's scene frame [m], with gray points; without points, and a note saying so, where a
        ground-truth recording has no usable semi-dense points.

    Raises:
        UserError: a file is missing or damaged, no frame lies within the trajectory, or (closed loop) no
            semi-dense point passes the filter.
    """
    if not is_rigid(device_from_camera):
        raise ValueError("device_from_camera is not a rigid motion")
    path = Path(folder) / TRAJECTORIES[trajectory]
    if not path.is_file():
        raise UserError(_missing(Path(folder), trajectory))
    rows = read_trajectory(path)
    bridged = at_times(rows, exposure_middle_ns, max_gap_ms)
    if not bridged.known.any():
        raise UserError(_no_frame(rows, exposure_middle_ns, bridged, max_gap_ms))
    camera_to_world = unregistered(len(bridged.known))
    camera_to_world[bridged.known] = bridged.poses[bridged.known] @ device_from_camera
    points, point_notes = _points(Path(folder), trajectory == "closed_loop", max_inv_dist_std, max_dist_std)
    tilt = _angle_deg(rows.up, mean_camera_up(camera_to_world[bridged.known]))
    if tilt > MOST_TILT_DEG:
        log(f"{path}: up is {tilt:.0f} degrees from up in the pictures: are the pictures upright?")
    notes = {
        "trajectory": trajectory,
        "frames": len(bridged.known),
        "registered": int(bridged.known.sum()),
        "frames_outside_trajectory": bridged.outside,
        "frames_in_gaps": bridged.in_gaps,
        "largest_gap_bridged_ms": bridged.largest_gap_ms,
        "up_against_pictures_deg": tilt,
        "scale": "metres",
        **point_notes,
    }
    colours = np.full(points.shape, GRAY, np.uint8)
    return Poses(camera_to_world, bridged.known, camera, points, colours, rows.up, notes).check()


def _missing(folder: Path, trajectory: str) -> str:
    """What to do without a trajectory: its sibling is named where it is there."""
    there = [name for name, path in TRAJECTORIES.items() if (folder / path).is_file()]
    advice = f", or set poses.trajectory={there[0]}, which is there" if there else ""
    others = [str(path) for name, path in TRAJECTORIES.items() if name != trajectory]
    lack = "" if there else f" (nor is there {', '.join(others)})"
    return f"{folder / TRAJECTORIES[trajectory]} is missing{lack}: download it{advice}"


def _angle_deg(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)))


def _points(
    folder: Path, required: bool, max_inv_dist_std: float, max_dist_std: float
) -> tuple[NDArray[np.float64], dict[str, Any]]:
    """The semi-dense points and the notes on them; none where they are missing and not required."""
    path = find_points(folder / MPS_FOLDER)
    if path is None:
        if required:
            raise UserError(
                f"{folder / MPS_FOLDER} has no {' or '.join(FILE_NAMES)}: download the MPS point cloud"
            )
        return np.empty((0, 3)), {"points": 0, "points_missing": "the recording has no semi-dense points"}
    found = read_semidense_points(path, max_inv_dist_std, max_dist_std)
    notes = {
        "points": len(found.points),
        "points_read": found.read,
        "points_rejected": found.rejected,
        "max_inv_dist_std": max_inv_dist_std,
        "max_dist_std": max_dist_std,
    }
    if len(found.points) == 0:
        if required:
            raise UserError(
                f"{path}: none of {found.read} points passes inv_dist_std < {max_inv_dist_std}"
                f" and dist_std < {max_dist_std}: raise these limits"
            )
        notes["points_missing"] = "no semi-dense point passes the filter"
    return found.points, notes


def _no_frame(rows: Trajectory, frame_ns: NDArray[np.int64], bridged: Bridged, max_gap_ms: float) -> str:
    if len(frame_ns) == 0:
        return f"{rows.path}: there is no frame to find a pose for"
    if bridged.in_gaps:
        return (
            f"{rows.path}: every frame lies between rows more than {max_gap_ms:g} ms apart: raise max_gap_ms"
        )
    first, last = (time * 1e-9 for time in (rows.timestamp_ns[0], rows.timestamp_ns[-1]))
    return (
        f"{rows.path} covers {first:.3f} s to {last:.3f} s, but the frames lie from"
        f" {frame_ns.min() * 1e-9:.3f} s to {frame_ns.max() * 1e-9:.3f} s: are both of one recording?"
    )

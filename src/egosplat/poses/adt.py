"""Poses of an Aria Digital Twin (ADT) recording, from its MPS trajectory or its ground truth. ADT publishes
the MPS output aligned with the ground truth ("ADT Data Format", Aligning Ground Truth and MPS Data). The
semi-dense points are a gzipped table (projectaria_tools, "MPS output - Semi-dense point cloud")."""

import gzip
import zlib
from pathlib import Path

import numpy as np
import pandas as pd

from egosplat.arrays import Array, Ints
from egosplat.calibration.files import MPS_FOLDER, TRAJECTORIES, find_points
from egosplat.errors import UserError
from egosplat.geometry import Camera, known_poses
from egosplat.poses.options import PosesOptions
from egosplat.poses.result import Poses
from egosplat.poses.trajectory import MAX_POSITION_M, interpolate_trajectory, read_trajectory

# Longest gap in the device's trajectory that is interpolated [ms]: one missing row of ground truth, which has one every
# 33.3 ms; a closed-loop trajectory has one a millisecond.
MAX_GAP_MS = 50.0

# The cameras that observe the points are monochrome, so the file has no colors.
GRAY = 128

_POSITION = ["px_world", "py_world", "pz_world"]
_COLUMNS = [*_POSITION, "inv_dist_std", "dist_std"]
# EgoLifter's limits of a point's standard deviations: of the inverse distance [1/m], and of the distance [m].
MAX_INV_DIST_STD, MAX_DIST_STD_M = 0.001, 0.15


def adt_poses(
    folder: Path, exposure_middle_ns: Ints, device_from_camera: Array, camera: Camera, options: PosesOptions
) -> Poses:
    """Interpolate the trajectory of an ADT recording at its frames, and read its points [m]
    (docs/method.md#poses). Frames outside the trajectory, or between rows further apart than ``MAX_GAP_MS``,
    are not registered. UserError if the trajectory is missing, a file is damaged, or no frame lies within the
    trajectory. ``exposure_middle_ns``: (F,) int64 middle of each exposure, in the
    device's clock. ``device_from_camera``: (4, 4) float64; camera axes are those of the (upright) frames."""
    path = folder / TRAJECTORIES[options.trajectory]
    if not path.is_file():
        others = [key for key, other in TRAJECTORIES.items() if (folder / other).is_file()]
        advice = [f", or set poses.trajectory={key}, which is there" for key in others]
        raise UserError(f"{path} is missing: download it{''.join(advice)}")
    trajectory = read_trajectory(path)
    # EgoLifter takes the nearest row instead (docs/method.md#trajectory).
    world_from_device = interpolate_trajectory(trajectory, exposure_middle_ns, MAX_GAP_MS)
    if not len(known_poses(world_from_device)):
        first, last = trajectory.timestamp_ns[[0, -1]] * 1e-9
        raise UserError(
            f"{path} covers {first:.3f} s to {last:.3f} s, and no frame from {exposure_middle_ns.min() * 1e-9:.3f} s to "
            f"{exposure_middle_ns.max() * 1e-9:.3f} s lies between rows up to {MAX_GAP_MS:g} ms apart: are both of the same "
            "recording? If so, download it again, or set poses.trajectory to the other"
        )
    # Both trajectories are in ADT's scene frame, which ADT publishes already aligned: no alignment is needed here.
    camera_to_world = world_from_device @ device_from_camera
    points = read_semidense_points(folder)
    colors = np.full(points.shape, GRAY, np.uint8)
    return Poses(camera_to_world, camera, points, colors, trajectory.up, {"scale": "meters"})


def read_semidense_points(folder: Path) -> Array:
    """(P, 3) float64 semi-dense points [m] with a small position uncertainty (docs/method.md#point-filter); none
    without a file. UserError if it is damaged."""
    if (path := find_points(folder / MPS_FOLDER)) is None:
        return np.empty((0, 3))
    try:
        table = pd.read_csv(path, usecols=_COLUMNS, dtype=np.float64)
    except (ValueError, gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise UserError(f"{path} is not a readable MPS point cloud ({error}); download it again") from error
    position = table[_POSITION].to_numpy()
    # A position that is no number is not within it either.
    near = (np.abs(position) <= MAX_POSITION_M).all(axis=1)
    sure = (table["inv_dist_std"] < MAX_INV_DIST_STD) & (table["dist_std"] < MAX_DIST_STD_M)
    return position[near & sure.to_numpy()]

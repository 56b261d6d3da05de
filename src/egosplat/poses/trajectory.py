"""Read and interpolate trajectories: MPS' ``closed_loop_trajectory.csv`` and ADT's ``aria_trajectory.csv``."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from egosplat.arrays import Array, Ints
from egosplat.errors import UserError
from egosplat.geometry import interpolate_poses, make_pose

_TIME, _FRAME = "tracking_timestamp_us", "graph_uid"
_NUMBERS = [
    _TIME,
    *(f"t{axis}_world_device" for axis in "xyz"),
    *(f"q{axis}_world_device" for axis in "xyzw"),
    *(f"gravity_{axis}_world" for axis in "xyz"),
]

# Rows are printed with few digits, so quaternions are not exactly of unit norm.
_QUATERNION_NORM_TOLERANCE = 1e-2
# Plausible length of the mean gravity vector [m/s²].
_GRAVITY_RANGE = (9.0, 10.5)
# Positions beyond this are damaged data.
MAX_POSITION_M = 1e6


@dataclass(frozen=True)
class Trajectory:
    """Poses of the device over time.

    Attributes:
        timestamp_ns: (N,) int64, strictly increasing, N >= 2, in the device's clock.
        world_from_device: (N, 4, 4) float64.
        up: (3,) float64 unit vector against gravity in the world.
    """

    timestamp_ns: Ints
    world_from_device: Array
    up: Array


def read_trajectory(path: Path) -> Trajectory:
    """Read a trajectory table (UserError: the file lacks a column or a second row, or has a bad row, whose
    line the message names)."""
    # ``projectaria_tools.core.mps`` (2.3) stops at a damaged row and returns the rows before without an error, and it
    # returns NaN poses for a quaternion of zero norm.
    table = _read_table(path)
    columns = [pd.to_numeric(table[name], errors="coerce") for name in _NUMBERS]
    time_us, *_ = numbers = np.array(columns, np.float64)
    translation, quaternion, gravity = (rows.T for rows in np.split(numbers[1:], [3, 7]))
    frame, length = table[_FRAME].to_numpy(), np.linalg.norm(quaternion, axis=1)
    far = (np.abs(translation) > MAX_POSITION_M).any(axis=1)
    faults = {
        "has a value that is missing or not a finite number": ~np.isfinite(numbers).all(axis=0),
        "belongs to another world frame (graph_uid) than the first row": frame != frame[0],
        f"has a {_TIME} not after that of the previous row": np.diff(time_us, prepend=time_us[0] - 1) <= 0,
        "has a quaternion without unit norm": np.abs(length - 1.0) > _QUATERNION_NORM_TOLERANCE,
        "has a position more than 1,000 km from the origin": far,
    }
    for problem, bad in faults.items():
        if bad.any():
            # Line 1 is the header.
            raise UserError(
                f"{path}, line {bad.argmax() + 2} (bad lines: {bad.sum()}): the row {problem}; correct the file or "
                "download it again"
            )
    up = -gravity.mean(axis=0)
    size = float(np.linalg.norm(up))
    if not _GRAVITY_RANGE[0] <= size <= _GRAVITY_RANGE[1]:
        raise UserError(
            f"{path}: the mean gravity_world is {size:.3g} m/s^2 long, not about 9.81: download it again"
        )
    poses = make_pose(Rotation.from_quat(quaternion).as_matrix(), translation)
    # Integers from here on: float64 holds microseconds since 1970, but not nanoseconds.
    return Trajectory(time_us.astype(np.int64) * 1000, poses, up / size)


def _read_table(path: Path) -> pd.DataFrame:
    try:
        table = pd.read_csv(path, usecols=lambda name: name in {_FRAME, *_NUMBERS}, low_memory=False)
    except ValueError as error:
        raise UserError(f"{path} is not a readable trajectory table ({error}); download it again") from error
    if missing := [name for name in (_FRAME, *_NUMBERS) if name not in table.columns]:
        raise UserError(f"{path} has no column {', '.join(missing)}: give a trajectory of MPS or of ADT 2.0")
    if len(table) < 2:
        raise UserError(f"{path} has {len(table)} rows; a trajectory needs at least two: download it again")
    return table


def interpolate_trajectory(trajectory: Trajectory, timestamp_ns: Ints, max_gap_ms: float) -> Array:
    """Interpolate the device's poses at (F,) int64 times: (F, 4, 4) float64. A time outside the trajectory,
    or between rows more than ``max_gap_ms`` apart, gets NaN."""
    times = trajectory.timestamp_ns
    inside = (timestamp_ns >= times[0]) & (timestamp_ns <= times[-1])
    after = np.clip(np.searchsorted(times, timestamp_ns), 1, len(times) - 1)
    # A time on a row needs no interpolation, even next to a gap.
    on_row = (times[after] == timestamp_ns) | (times[after - 1] == timestamp_ns)
    gap_ms = np.where(on_row, 0.0, (times[after] - times[after - 1]) * 1e-6)
    known = inside & (gap_ms <= max_gap_ms)
    poses = np.full((len(timestamp_ns), 4, 4), np.nan)
    poses[known] = interpolate_poses(times, trajectory.world_from_device, timestamp_ns[known])
    return poses

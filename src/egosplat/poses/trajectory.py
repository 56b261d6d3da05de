"""Read and interpolate trajectories: MPS' ``closed_loop_trajectory.csv`` and ADT's ``aria_trajectory.csv``."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from egosplat.errors import UserError
from egosplat.geometry import interpolate_poses, make_pose

_TIME = "tracking_timestamp_us"
_FRAME = "graph_uid"
_TRANSLATION = [f"t{axis}_world_device" for axis in "xyz"]
_QUATERNION = [f"q{axis}_world_device" for axis in "xyzw"]
_GRAVITY = [f"gravity_{axis}_world" for axis in "xyz"]
_NUMBERS = [_TIME, *_TRANSLATION, *_QUATERNION, *_GRAVITY]

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

    path: Path
    timestamp_ns: NDArray[np.int64]
    world_from_device: NDArray[np.float64]
    up: NDArray[np.float64]


@dataclass(frozen=True)
class InterpolatedPoses:
    """Poses of a trajectory at given times.

    Attributes:
        poses, known: (F, 4, 4) float64, NaN where unknown; (F,) bool: times with a pose.
        outside, in_gaps: number of times before the first or after the last row, and between rows too far apart.
        largest_gap_ms: largest time between two rows that were interpolated; 0 if none were.
    """

    poses: NDArray[np.float64]
    known: NDArray[np.bool_]
    outside: int
    in_gaps: int
    largest_gap_ms: float


def read_trajectory(path: Path) -> Trajectory:
    """Read a trajectory table.

    Raises:
        UserError: the file is missing, lacks a column or a second row, or has a bad row, whose line the message names.
    """
    # ``projectaria_tools.core.mps`` (2.3) stops at a damaged row and returns the rows before without an error, and it
    # returns NaN poses for a quaternion of zero norm.
    table = _read_table(path)
    numbers: pd.DataFrame = table[_NUMBERS].apply(pd.to_numeric, errors="coerce")
    not_finite = ~np.isfinite(numbers).to_numpy().all(axis=1)
    _check_rows(path, not_finite, "has a value that is missing or not a finite number")
    frame = table[_FRAME].to_numpy()
    _check_rows(path, frame != frame[0], "belongs to another world frame (graph_uid) than the first row")
    # Integers from here on: float64 holds microseconds since 1970, but not nanoseconds.
    time_us = numbers[_TIME].to_numpy().astype(np.int64)
    not_after = np.diff(time_us, prepend=time_us[0] - 1) <= 0
    _check_rows(path, not_after, f"has a {_TIME} not after that of the previous row")
    quaternion = numbers[_QUATERNION].to_numpy(np.float64)
    off = np.abs(np.linalg.norm(quaternion, axis=1) - 1.0)
    _check_rows(path, off > _QUATERNION_NORM_TOLERANCE, "has a quaternion without unit norm")
    translation = numbers[_TRANSLATION].to_numpy(np.float64)
    far = (np.abs(translation) > MAX_POSITION_M).any(axis=1)
    _check_rows(path, far, "has a position more than 1,000 km from the origin")
    gravity = numbers[_GRAVITY].to_numpy(np.float64).mean(axis=0)
    length = float(np.linalg.norm(gravity))
    if not _GRAVITY_RANGE[0] <= length <= _GRAVITY_RANGE[1]:
        raise UserError(
            f"{path}: the mean gravity_world is {length:.3g} m/s^2 long, not about 9.81: download it again"
        )
    poses = make_pose(Rotation.from_quat(quaternion).as_matrix(), translation)
    return Trajectory(path, time_us * 1000, poses, -gravity / length)


def interpolate_trajectory(
    trajectory: Trajectory, timestamp_ns: NDArray[np.int64], max_gap_ms: float
) -> InterpolatedPoses:
    """Interpolate the device's poses at (F,) int64 times; those between rows more than ``max_gap_ms`` apart get none."""
    times = trajectory.timestamp_ns
    wanted = np.asarray(timestamp_ns, dtype=np.int64)
    inside = (wanted >= times[0]) & (wanted <= times[-1])
    after = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1)
    # A time on a row needs no interpolation, even next to a gap.
    on_row = inside & ((times[after] == wanted) | (times[after - 1] == wanted))
    gap_ms = np.where(on_row, 0.0, (times[after] - times[after - 1]) * 1e-6)
    known = inside & (gap_ms <= max_gap_ms)
    poses = np.full((len(wanted), 4, 4), np.nan)
    poses[known] = interpolate_poses(times, trajectory.world_from_device, wanted[known])
    outside, in_gaps = int((~inside).sum()), int((inside & ~known).sum())
    return InterpolatedPoses(poses, known, outside, in_gaps, float(gap_ms[known].max(initial=0.0)))


def _read_table(path: Path) -> pd.DataFrame:
    if not path.is_file():
        raise UserError(f"{path} is missing: download the trajectory")
    try:
        table = pd.read_csv(path, usecols=lambda name: name in {_FRAME, *_NUMBERS}, low_memory=False)
    except (ValueError, pd.errors.ParserError, UnicodeDecodeError) as error:
        raise UserError(f"{path} is not a readable trajectory table ({error}); download it again") from error
    if missing := [name for name in (_FRAME, *_NUMBERS) if name not in table.columns]:
        raise UserError(f"{path} has no column {', '.join(missing)}: give a trajectory of MPS or of ADT 2.0")
    if len(table) < 2:
        raise UserError(f"{path} has {len(table)} rows; a trajectory needs at least two: download it again")
    return table


def _check_rows(path: Path, bad_rows: NDArray[np.bool_], problem: str) -> None:
    """Raise UserError naming the line of the first bad row, if there is one."""
    if len(bad := np.flatnonzero(bad_rows)):
        more = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
        # Line 1 is the header.
        raise UserError(
            f"{path}, line {bad[0] + 2}{more}: the row {problem}; correct the file or download it again"
        )

"""Trajectories as MPS writes them to ``closed_loop_trajectory.csv``, and ADT to ``aria_trajectory.csv``.

The tables are read here and not with ``projectaria_tools.core.mps``: that reader (2.3) stops at a damaged row
and returns the rows before it without an error, and gives NaN poses for a quaternion of zero norm.
"""

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

_QUATERNION_NORM_TOLERANCE = 1e-2
_GRAVITY_RANGE = (9.0, 10.5)
FARTHEST_M = 1e6
"""Further from where the recording began nobody walks."""


@dataclass(frozen=True)
class Trajectory:
    """Poses of the device over time.

    Attributes:
        path: the file.
        timestamp_ns: (N,) int64, strictly increasing, N >= 2, in the device's clock.
        world_from_device: (N, 4, 4) float64.
        up: (3,) float64: unit vector against gravity in the world.
    """

    path: Path
    timestamp_ns: NDArray[np.int64]
    world_from_device: NDArray[np.float64]
    up: NDArray[np.float64]


@dataclass(frozen=True)
class Bridged:
    """Poses of a trajectory at given times.

    Attributes:
        poses: (F, 4, 4) float64; NaN where there is none.
        known: (F,) bool.
        outside: number of times before the first or after the last row.
        in_gaps: number of times whose neighbouring rows lie too far apart.
        largest_gap_ms: the longest time between two rows that a pose was interpolated across; 0 if none was.
    """

    poses: NDArray[np.float64]
    known: NDArray[np.bool_]
    outside: int
    in_gaps: int
    largest_gap_ms: float


def read_trajectory(path: Path) -> Trajectory:
    """Read a trajectory table.

    Raises:
        UserError: the file is missing, has no such columns, fewer than two rows, or a row that cannot be used
            (the message names its line): a value that is not a finite number, a time not after the one
            before, a quaternion that is not of unit norm, a position out of this world, poses in another frame
            than the rows before.
    """
    table = _read_table(path)
    numbers = table[_NUMBERS].apply(pd.to_numeric, errors="coerce")
    _refuse(
        path,
        ~np.isfinite(numbers).to_numpy().all(axis=1),
        "has a value that is missing or not a finite number",
    )
    frame = table[_FRAME].to_numpy()
    _refuse(path, frame != frame[0], "belongs to another world frame (graph_uid) than the first row")
    time_us = numbers[_TIME].to_numpy().astype(np.int64)
    _refuse(
        path, np.diff(time_us, prepend=time_us[0] - 1) <= 0, f"has a {_TIME} not after that of the row before"
    )
    quaternion = numbers[_QUATERNION].to_numpy(np.float64)
    off = np.abs(np.linalg.norm(quaternion, axis=1) - 1.0)
    _refuse(path, off > _QUATERNION_NORM_TOLERANCE, "has a quaternion that is not of unit norm")
    translation = numbers[_TRANSLATION].to_numpy(np.float64)
    far = (np.abs(translation) > FARTHEST_M).any(axis=1)
    _refuse(path, far, "has a position more than 1,000 km from the origin")
    poses = make_pose(Rotation.from_quat(quaternion).as_matrix(), translation)
    return Trajectory(path, time_us * 1000, poses, _up(path, numbers[_GRAVITY].to_numpy(np.float64)))


def at_times(trajectory: Trajectory, timestamp_ns: NDArray[np.int64], max_gap_ms: float) -> Bridged:
    """Interpolate the poses of the device between rows.

    Args:
        trajectory: as read.
        timestamp_ns: (F,) int64 in the device's clock.
        max_gap_ms: rows further apart than this are not interpolated between.
    """
    times = trajectory.timestamp_ns
    wanted = np.asarray(timestamp_ns, dtype=np.int64)
    inside = (wanted >= times[0]) & (wanted <= times[-1])
    after = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1)
    # A time that a row has needs no neighbour, however long the trajectory pauses after it.
    on_row = inside & ((times[after] == wanted) | (times[after - 1] == wanted))
    gap_ms = np.where(on_row, 0.0, (times[after] - times[after - 1]) * 1e-6)
    known = inside & (gap_ms <= max_gap_ms)
    poses = np.full((len(wanted), 4, 4), np.nan)
    poses[known] = interpolate_poses(times, trajectory.world_from_device, wanted[known])
    return Bridged(
        poses,
        known,
        outside=int((~inside).sum()),
        in_gaps=int((inside & ~known).sum()),
        largest_gap_ms=float(gap_ms[known].max(initial=0.0)),
    )


def _read_table(path: Path) -> pd.DataFrame:
    if not path.is_file():
        raise UserError(f"{path} is missing: download the trajectory")
    try:
        table = pd.read_csv(path, usecols=lambda name: name in {_FRAME, *_NUMBERS}, low_memory=False)
    except (ValueError, pd.errors.ParserError, UnicodeDecodeError) as error:
        raise UserError(f"{path} is not a table of a trajectory ({error}); download it again") from error
    missing = [name for name in (_FRAME, *_NUMBERS) if name not in table.columns]
    if missing:
        raise UserError(
            f"{path} has no column {', '.join(missing)}: it must be a trajectory of MPS or of ADT 2.0"
        )
    if len(table) < 2:
        raise UserError(f"{path} has {len(table)} rows; a trajectory needs two at least: download it again")
    return table


def _refuse(path: Path, bad_rows: NDArray[np.bool_], what: str) -> None:
    bad = np.flatnonzero(bad_rows)
    if len(bad):
        more = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
        raise UserError(
            f"{path}, line {bad[0] + 2}{more}: the row {what}; mend the file or download it again"
        )


def _up(path: Path, gravity: NDArray[np.float64]) -> NDArray[np.float64]:
    mean = gravity.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if not _GRAVITY_RANGE[0] <= length <= _GRAVITY_RANGE[1]:
        raise UserError(
            f"{path}: the mean gravity_world is {length:.3g} m/s^2 long, not about 9.81: download it again"
        )
    return -mean / length

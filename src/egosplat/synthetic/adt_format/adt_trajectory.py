"""The device trajectory and the semi-dense points, as in ADT and Aria's Machine Perception Services."""

import json
import uuid
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from egosplat.geometry import compose
from egosplat.synthetic.adt_format.sequence import Sequence

Times = NDArray[np.int64]

_TRUTH_PERIOD_US, _SLAM_PERIOD_US = 33_333, 1000
_VELOCITY_STEP_NS = 500_000
_GRAVITY_WORLD = (0.0, -9.81, 0.0)


def write_trajectories(folder: Path, sequence: Sequence, truth_ns: Times, middle_ns: Times) -> None:
    """Write ``aria_trajectory.csv`` and the files of MPS in ``mps/slam/``.

    Rows are 33 ms and 1 ms apart, as in ADT, at any frame rate. Both files also have a row at every
    ground-truth time and one within 0.5 us of the middle of every exposure, so that a pose at these times
    needs no interpolation. The rows cover the sequence from start to end.

    Args:
        folder: the sequence folder.
        truth_ns: (F,) ground-truth times; middle_ns: (F,) middles of the exposures.

    Raises:
        ValueError: one of these times lies outside the trajectory.
    """
    span_us = np.array([-(-sequence.start_ns // 1000), sequence.end_ns // 1000])
    needed_us = np.concatenate([_to_us(truth_ns), _to_us(middle_ns)])
    if len(needed_us) and (needed_us.min() < span_us[0] or needed_us.max() > span_us[1]):
        raise ValueError("the trajectory does not cover every frame's ground-truth time and exposure middle")
    slam = folder / "mps" / "slam"
    slam.mkdir(parents=True)
    periods = {
        folder / "aria_trajectory.csv": _TRUTH_PERIOD_US,
        slam / "closed_loop_trajectory.csv": _SLAM_PERIOD_US,
    }
    for path, period_us in periods.items():
        # The needed times are rows of their own, so that a reader interpolates nothing there.
        grid_us = np.arange(*span_us, period_us)
        times_us = np.unique(np.concatenate([span_us, grid_us, needed_us]))
        trajectory_table(sequence, times_us).to_csv(path, index=False)
    _write_points(slam / "semidense_points.csv.gz", sequence)
    summary = {"SLAM": {"status": "SUCCESS", "message": "synthetic: exact poses, not estimated ones"}}
    (slam / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")


def trajectory_table(sequence: Sequence, times_us: Times) -> pd.DataFrame:
    """Columns of the closed-loop trajectory at ``times_us``, (N,) increasing microseconds of device time."""
    pose = sequence.device_pose(times_us * 1000)
    linear, angular = _velocities(sequence, times_us * 1000)
    count = len(times_us)
    quaternion = Rotation.from_matrix(pose[:, :3, :3]).as_quat(canonical=True)
    columns = {"graph_uid": _graph_uid(sequence), "tracking_timestamp_us": times_us, "utc_timestamp_ns": -1}
    columns |= {f"t{axis}_world_device": pose[:, row, 3] for row, axis in enumerate("xyz")}
    columns |= {f"q{axis}_world_device": quaternion[:, row] for row, axis in enumerate("xyzw")}
    columns |= {f"device_linear_velocity_{axis}_device": linear[:, row] for row, axis in enumerate("xyz")}
    columns |= {f"angular_velocity_{axis}_device": angular[:, row] for row, axis in enumerate("xyz")}
    columns |= {f"gravity_{axis}_world": _GRAVITY_WORLD[row] for row, axis in enumerate("xyz")}
    return pd.DataFrame({**columns, "quality_score": np.ones(count)})


def _velocities(sequence: Sequence, times_ns: Times) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, 3) linear [m/s] and angular [rad/s] velocity in the device frame, from differences over 1 ms."""
    # Central differences, one-sided at the ends of the trajectory.
    before = np.maximum(times_ns - _VELOCITY_STEP_NS, sequence.start_ns)
    after = np.minimum(times_ns + _VELOCITY_STEP_NS, sequence.end_ns)
    seconds = np.maximum(after - before, 1)[:, None] * 1e-9
    first, last = sequence.device_pose(before), sequence.device_pose(after)
    to_device = np.swapaxes(first[:, :3, :3], -1, -2)
    linear = np.einsum("nij,nj->ni", to_device, last[:, :3, 3] - first[:, :3, 3]) / seconds
    angular = Rotation.from_matrix(compose(to_device, last[:, :3, :3])).as_rotvec() / seconds
    return linear, angular


def _write_points(path: Path, sequence: Sequence) -> None:
    count = len(sequence.points)
    columns = {"uid": np.arange(count), "graph_uid": _graph_uid(sequence)}
    columns |= {f"p{axis}_world": sequence.points[:, row] for row, axis in enumerate("xyz")}
    columns |= {"inv_dist_std": sequence.inv_dist_std, "dist_std": sequence.dist_std}
    # A fixed time in the gzip header, so that the same sequence gives the same bytes.
    pd.DataFrame(columns).to_csv(path, index=False, compression={"method": "gzip", "mtime": 0})


def _graph_uid(sequence: Sequence) -> str:
    """Identifier of the world frame."""
    return str(uuid.uuid5(uuid.NAMESPACE_URL, f"egosplat/{sequence.name}"))


def _to_us(times_ns: Times) -> Times:
    return (np.asarray(times_ns, dtype=np.int64) + 500) // 1000

"""The files of a recording that the stage ``poses`` opens: the readers find them here, and so do the rules.

The workflow imports this module, so it stays light. A missing file is no error here; its reader reports it.
"""

from pathlib import Path

from egosplat.calibration.companions import known_pose_files

MPS_FOLDER = Path("mps") / "slam"

# The trajectories of an ADT recording, by the value of ``poses.trajectory``.
TRAJECTORIES = {
    "closed_loop": MPS_FOLDER / "closed_loop_trajectory.csv",
    "ground_truth": Path("aria_trajectory.csv"),
}

# Current and older name of the points' file.
POINTS = ("semidense_points.csv.gz", "global_points.csv.gz")


def poses_files(source: str, recording: Path, trajectory: str, known_poses: str) -> list[Path]:
    """The existing files that the stage opens, by ``poses_source``, ``poses.trajectory`` and ``frames.known_poses``."""
    if source == "device":
        points = find_points(recording / MPS_FOLDER)
        found = [recording / TRAJECTORIES[trajectory], *([points] if points else [])]
    else:
        found = known_pose_files(recording, known_poses) if source == "known" else []
    return [path for path in found if path.is_file()]


def find_points(folder: Path) -> Path | None:
    """Path of the point cloud in an MPS folder; None if there is none."""
    return next((folder / name for name in POINTS if (folder / name).is_file()), None)

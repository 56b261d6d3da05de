"""The viewpoint of a query: a frame of the recording, or any pose."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from egosplat.errors import UserError
from egosplat.files import read_json
from egosplat.geometry import Array, is_rigid
from egosplat.query.maps import Mask

# A (4, 4) camera_to_world, or a JSON file {"camera_to_world": 4 rows of 4 numbers}.
Pose = Array | Path | str


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A pose of the recording's camera.

    Attributes:
        camera_to_world: (4, 4) float64, OpenCV axes, meters.
        valid: (H, W) bool pixels that show the scene, or None for all.
        second: time [s since the first frame], at which it shows what lies there then, too; None for what stays.
    """

    name: str
    camera_to_world: Array
    valid: Mask | None
    second: float | None = None


def pose_viewpoint(pose: Pose, second: float | None = None) -> Viewpoint:
    """The viewpoint of a pose, named like its file, at a time or of none (UserError: no file, or no rigid motion)."""
    if isinstance(pose, str | Path):
        name, where, matrix = Path(pose).name, f"pose {pose}", _read_pose(Path(pose))
    else:
        name, where, matrix = "a pose", "pose", np.asarray(pose, np.float64)
    if matrix.shape != (4, 4) or not is_rigid(matrix):
        what = "camera_to_world is not a rigid motion: a 4x4 rotation and translation, last row 0 0 0 1"
        raise UserError(f"{where}: {what}")
    return Viewpoint(name, matrix, None, second)


def _read_pose(path: Path) -> Array:
    try:
        return np.array(read_json(path)["camera_to_world"], np.float64)
    except FileNotFoundError:
        raise UserError(f"pose {path}: does not exist") from None
    except (OSError, ValueError, TypeError, KeyError, OverflowError) as error:
        reason = str(error).partition("\n")[0]
        raise UserError(f"pose {path}: is not JSON with 4x4 numbers camera_to_world ({reason})") from None

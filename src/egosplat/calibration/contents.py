"""What a file with known poses holds, whichever its format."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.lens import Lens


@dataclass(frozen=True)
class Contents:
    """Calibration, poses and points from one file or folder.

    Attributes:
        camera_file, pose_file: names for errors.
        lens: of the full-size pictures.
        names: N names of pictures, as the file spells them.
        camera_to_world: (N, 4, 4) float64, OpenCV axes, in the file's own world and unit.
        points: (P, 3) float64 in the same world.
        point_rgb: (P, 3) uint8.
        point_views: (P,) int64: number of pictures that see each point; 0 where the file does not say.
        point_error_px: (P,) float64 mean reprojection error [px of the full-size pictures]; 0 where not known.
        notes: further facts, as plain JSON.
    """

    camera_file: str
    pose_file: str
    lens: Lens
    names: list[str]
    camera_to_world: NDArray[np.float64]
    points: NDArray[np.float64]
    point_rgb: NDArray[np.uint8]
    point_views: NDArray[np.int64]
    point_error_px: NDArray[np.float64]
    notes: dict[str, Any] = field(default_factory=dict)

    def with_poses(self, camera_to_world: NDArray[np.float64]) -> "Contents":
        """The same contents with other poses."""
        return replace(self, camera_to_world=camera_to_world)

"""What a file with known poses holds, whichever its format."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from egosplat.calibration.lens import Lens


@dataclass(frozen=True)
class Contents:
    """Calibration, poses and points from one file or folder.

    Attributes:
        camera_file, pose_file: names for errors.
        lenses, lens_of: of the full-size pictures, and (N,) int64 the index of each picture's.
        names: of N pictures, as the file spells them.
        camera_to_world: (N, 4, 4) float64, OpenCV axes, in the file's own world and unit.
        points, point_rgb: (P, 3) float64 in the same world, (P, 3) uint8.
        point_views: (P,) int64: number of pictures that see each point; 0 where the file does not say.
        point_error_px: (P,) float64 mean reprojection error [px of the full-size pictures]; 0 where not known.
        masks: the mask of each picture, black where it is not to be used, or None; empty if there is none.
        unread: keys of the file that do not count.
        notes: further facts, as plain JSON.
    """

    camera_file: str
    pose_file: str
    lenses: list[Lens]
    lens_of: NDArray[np.int64]
    names: list[str]
    camera_to_world: NDArray[np.float64]
    points: NDArray[np.float64]
    point_rgb: NDArray[np.uint8]
    point_views: NDArray[np.int64]
    point_error_px: NDArray[np.float64]
    masks: list[Path | None] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)
    notes: dict[str, Any] = field(default_factory=dict)

"""Read the points of ``prompts.zarr``."""

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.prompts import PROMPTS
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.errors import UserError


class PlacedPoints:
    """The points that each frame is prompted with."""

    def __init__(self, path: Path | None, frames: Artifact) -> None:
        """Read the points.

        Raises:
            UserError: there is no path, or the points are of other frames.
        """
        if path is None:
            raise UserError("segments.point_prompts = depth needs the prompts artifact: give --prompts")
        self.artifact = open_artifact(path, PROMPTS)
        check_made_from(self.artifact, frames)
        self._frame = self.artifact.read("frame")
        self._position = torch.from_numpy(self.artifact.read("position"))

    def has(self, frames: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether each of (N,) frames has points."""
        return np.isin(frames, self._frame)

    def of(self, frame: int) -> Tensor:
        """Get the (P, 2) points of a frame, x, y in [0, 1]."""
        begin, end = np.searchsorted(self._frame, [frame, frame + 1])
        return self._position[begin:end]

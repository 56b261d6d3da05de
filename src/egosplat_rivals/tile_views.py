"""Targets from the tiles of views: features of pixels at any scale, and their regulariser."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import TILE_SCALES
from egosplat.errors import UserError
from egosplat.gaussians.training_views import StoredRows, stored_rows
from egosplat_rivals.tiles import Scale, at_pixels


class TileViews:
    """The tiles of frames, as many as ``stored_rows`` holds in memory.

    Attributes:
        scales: layout of each scale, finest first.
        channels: D of the features.
        components: K of the regulariser; 0 without one.
        stands_in: what replaces the foreign model of the published methods.
    """

    def __init__(self, learnt_from: Sequence[Artifact], frames: Artifact, device: torch.device) -> None:
        """Take the tiles of frames (UserError: they are of other frames)."""
        (tiles,) = learnt_from
        check_made_from(tiles, frames)
        self._path = tiles.path
        self._row = {int(frame): row for row, frame in enumerate(tiles.read("frame"))}
        self.scales = [Scale(**one) for one in tiles.facts["scales"]]
        self.channels = tiles.shape(TILE_SCALES[0])[-1]
        self.components = tiles.shape("regulariser")[-1] if tiles.has("regulariser") else 0
        names = [*TILE_SCALES, *(["regulariser"] if self.components else [])]
        self._rows = {name: _rows_of(tiles, name) for name in names}
        found = "SAM2's encoder" if self.components else "no regulariser"
        self.stands_in = f"{found} in place of DINO"

    def check_has(self, frames: NDArray[np.int64]) -> None:
        """Raise UserError unless all frames have tiles."""
        if missing := sorted(set(map(int, frames)) - set(self._row)):
            raise UserError(
                f"{self._path}: lacks the tiles of frame {missing[0]}. Delete it to encode them again"
            )

    def read(self, frame: int, number: int) -> Tensor:
        """(rows, columns, D) float16 features of a frame's tiles of one scale."""
        return self._rows[TILE_SCALES[number]][self._row[frame]]

    def between(self, frame: int, pixels: Tensor, scale: Tensor, part: Tensor) -> Tensor:
        """Interpolate between the tiles of a (P,) int64 scale and the next, (P,) ``part`` of 0 to 1, at (P, 2) columns and rows.

        Returns:
            (P, D) float32, not normalized.
        """
        found = torch.zeros(len(pixels), self.channels)
        for number in scale.unique().tolist():
            chosen = scale == number
            ends = [
                at_pixels(self.read(frame, one), self.scales[one], pixels[chosen])
                for one in (number, number + 1)
            ]
            found[chosen] = torch.lerp(*ends, part[chosen, None])
        return found

    def regulariser(self, frame: int) -> Tensor | None:
        """(h, w, K) float32 map of a frame; None without one."""
        if not self.components:
            return None
        return self._rows["regulariser"][self._row[frame]].float()


def _rows_of(tiles: Artifact, name: str) -> Tensor | StoredRows:
    """The array ``name`` of all frames."""
    count, *shape = tiles.shape(name)
    return stored_rows(count, tuple(shape), "float16", lambda row: tiles.row(name, row))


def nearest(image: Tensor, pixels: Tensor, width: int, height: int) -> Tensor:
    """(P, ...) values of an (h, w, ...) map of a whole image of ``width`` x ``height`` at (P, 2) pixels of it."""
    rows = (pixels[:, 1] + 0.5) * image.shape[0] / height
    columns = (pixels[:, 0] + 0.5) * image.shape[1] / width
    return image[rows.long().clamp(max=image.shape[0] - 1), columns.long().clamp(max=image.shape[1] - 1)]

"""LERF's pyramid of image tiles (Kerr et al., ICCV 2023): where its tiles lie, and features of pixels at any scale."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import TILE_SCALES
from egosplat.errors import UserError
from egosplat.gaussians.training_views import StoredRows

# Sides of the tiles as parts of the image's height.
RATIOS = tuple(0.05 + 0.075 * number for number in range(7))

# Tiles do not overlap at the first ratio; from the second on, neighbors overlap by half.
_APART, _HALF = 0.05, 0.15


@dataclass(frozen=True)
class Scale:
    """The grid of tiles of one size: side of a tile and stride from tile to tile [px], and numbers of tiles.

    The image is padded by ``kernel // 2`` black pixels on every side.
    """

    kernel: int
    stride: int
    rows: int
    columns: int

    @property
    def first(self) -> float:
        """Row and column of the center of the first tile, in pixel indices."""
        return (self.kernel - 1) / 2 - self.kernel // 2


def pyramid(height: int, width: int) -> list[Scale]:
    """Lay out the seven scales of an image, finest first; 881 tiles if it is a square of 512 pixels."""
    scales = []
    for ratio in RATIOS:
        # A little more, because 64 * 0.625 must not round down to 39.
        kernel = max(1, int(ratio * height + 1e-6))
        overlap = min(max((ratio - _APART) / (_HALF - _APART), 0.0), 1.0) / 2
        stride = max(1, int(kernel * (1 - overlap) + 1e-6))
        rows, columns = ((side + 2 * (kernel // 2) - kernel) // stride + 1 for side in (height, width))
        scales.append(Scale(kernel, stride, rows, columns))
    return scales


def at_pixels(tiles: Tensor, scale: Scale, pixels: Tensor) -> Tensor:
    """(P, D) float32 features of (rows, columns, D) tiles, bilinear between their centers at (P, 2) columns and rows.

    They are not normalized. Beyond the last tile, the last one continues.
    """
    at = (pixels - scale.first) / scale.stride
    most = torch.tensor([scale.columns - 1, scale.rows - 1])
    before = at.floor().long().clamp(min=0).minimum(most)
    after = (before + 1).minimum(most)
    part = (at - before).clamp(0.0, 1.0)[..., None]
    (left, top), (right, bottom) = before.unbind(1), after.unbind(1)
    upper = torch.lerp(tiles[top, left].float(), tiles[top, right].float(), part[:, 0])
    lower = torch.lerp(tiles[bottom, left].float(), tiles[bottom, right].float(), part[:, 0])
    return torch.lerp(upper, lower, part[:, 1])


class TileViews:
    """The tiles of frames, as many as ``StoredRows`` keeps in memory, with D ``channels`` and their layout by scale, finest first.

    ``components`` are K of the regulariser, 0 without one; ``stands_in`` says what replaces the published methods' model.
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
        self._rows = {name: StoredRows(partial(tiles.row, name)) for name in names}
        self.stands_in = "SAM2's encoder" if self.components else "no regulariser"
        self.stands_in += " in place of DINO"

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
        """(P, D) float32 features at (P, 2) columns and rows, not normalized.

        They are interpolated between the tiles of a (P,) int64 scale and the next, (P,) ``part`` of 0 to 1.
        """
        found = torch.zeros(len(pixels), self.channels)
        for number in scale.unique().tolist():
            chosen = scale == number
            first, second = (
                at_pixels(self.read(frame, end), self.scales[end], pixels[chosen])
                for end in (number, number + 1)
            )
            found[chosen] = torch.lerp(first, second, part[chosen, None])
        return found

    def regulariser(self, frame: int) -> Tensor | None:
        """(h, w, K) float32 map of a frame; None without one."""
        return self._rows["regulariser"][self._row[frame]].float() if self.components else None


def nearest(image: Tensor, pixels: Tensor, width: int, height: int) -> Tensor:
    """(P, ...) values of an (h, w, ...) map of a whole image of ``width`` x ``height`` at (P, 2) pixels of it."""
    rows = (pixels[:, 1] + 0.5) * image.shape[0] / height
    columns = (pixels[:, 0] + 0.5) * image.shape[1] / width
    return image[rows.long().clamp(max=image.shape[0] - 1), columns.long().clamp(max=image.shape[1] - 1)]

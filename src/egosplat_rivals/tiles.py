"""LERF's pyramid of image tiles (Kerr et al., ICCV 2023): where its tiles lie, and the feature of a pixel between them."""

from dataclasses import dataclass

import torch
from torch import Tensor

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
    return [_scale(ratio, height, width) for ratio in RATIOS]


def _scale(ratio: float, height: int, width: int) -> Scale:
    # A little more, because 64 * 0.625 must not round down to 39.
    kernel = max(1, int(ratio * height + 1e-6))
    overlap = min(max((ratio - _APART) / (_HALF - _APART), 0.0), 1.0) / 2
    stride = max(1, int(kernel * (1 - overlap) + 1e-6))
    padding = 2 * (kernel // 2) - kernel
    return Scale(kernel, stride, (height + padding) // stride + 1, (width + padding) // stride + 1)


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

"""All textures and their mip levels in one array, for vectorised lookup."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat_apartments.arrays import Floats, Ints
from egosplat_apartments.objects.textures import Texture

_LEVELS = 9


class Atlas:
    """Mip-mapped textures: a pixel that covers many texels gets their mean, which avoids aliasing."""

    def __init__(self, textures: Sequence[Texture]) -> None:
        levels = [_halvings(texture.pixels) for texture in textures]
        flat = [level.reshape(-1, 3) for pyramid in levels for level in pyramid]
        self._texels = np.pad(np.concatenate(flat), ((0, 0), (0, 1))).view(np.uint32)[:, 0]
        starts = np.cumsum([0, *(len(level) for level in flat[:-1])])
        self._start = starts.reshape(len(textures), _LEVELS).astype(np.int32)
        shapes = np.array([[level.shape[:2] for level in pyramid] for pyramid in levels], dtype=np.int32)
        self._rows, self._columns = shapes[..., 0].copy(), shapes[..., 1].copy()
        self._size = np.array([texture.size_m for texture in textures], dtype=np.float32)
        texel = self._size / shapes[:, 0, ::-1]
        self._log_texel = _log2(np.sqrt(texel.prod(axis=1)))
        coarsest = [(pyramid[-1].reshape(-1, 3) / 255.0) ** 2 for pyramid in levels]
        self.mean_albedo = np.array([texels.mean(axis=0) for texels in coarsest], dtype=np.float32)
        """(T, 3) mean reflectance of each texture, in linear light."""

    def albedo(self, texture: Ints, uv: Floats, footprint_m: Floats) -> Floats:
        """(N, 3) reflectance in linear light.

        Args:
            texture: (N,) texture numbers; uv: (N, 2) texture coordinates [m].
            footprint_m: (N,) width of a pixel on the surface [m].
        """
        detail = _log2(np.maximum(footprint_m, 1e-6)) - self._log_texel[texture]
        detail = np.clip(detail, 0.0, _LEVELS - 1.001).astype(np.float32)
        level = detail.astype(np.int32)
        place = uv / self._size[texture]
        color = self._bilinear(texture, level, place)
        share = detail - level
        blended = np.flatnonzero(share > 0.05)
        if len(blended):
            coarse = self._bilinear(texture[blended], level[blended] + 1, np.take(place, blended, axis=0))
            fine = np.take(color, blended, axis=1)
            color[:, blended] = fine + share[blended] * (coarse - fine)
        # Textures are in display values; the display's curve is a square root here as in the renderer.
        return np.ascontiguousarray((color * color).T)

    def _bilinear(self, texture: Ints, level: Ints, place: Floats) -> Floats:
        """(3, N) display values in 0..1. Sums over one color at a time take half the time of those over (N, 3)."""
        rows, columns = self._rows[texture, level], self._columns[texture, level]
        start = self._start[texture, level]
        x = place[:, 0] * columns - 0.5
        y = place[:, 1] * rows - 0.5
        x0, y0 = np.floor(x).astype(np.int32), np.floor(y).astype(np.int32)
        fx, fy = x - x0, y - y0
        x0 %= columns
        y0 %= rows
        x1, y1 = x0 + 1, y0 + 1
        x1[x1 == columns] = 0
        y1[y1 == rows] = 0
        top, bottom = start + y0 * columns, start + y1 * columns
        upper = self._texel(top + x0) * (1 - fx) + self._texel(top + x1) * fx
        lower = self._texel(bottom + x0) * (1 - fx) + self._texel(bottom + x1) * fx
        return (upper * (1 - fy) + lower * fy) * np.float32(1 / 255)

    def _texel(self, index: Ints) -> NDArray[np.float64]:
        """(3, N) texels. Gathering one word per texel is several times faster than gathering three bytes."""
        return np.take(self._texels, index).view(np.uint8).reshape(-1, 4).T[:3].astype(np.float64, "C")


def _log2(values: Floats) -> Floats:
    """Base-2 logarithm, computed in float64 because float32's last bits depend on the processor."""
    return np.log2(values.astype(np.float64)).astype(np.float32)


def _halvings(pixels: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    pyramid = [pixels]
    while len(pyramid) < _LEVELS:
        height, width = pyramid[-1].shape[:2]
        size = (max(1, width // 2), max(1, height // 2))
        pyramid.append(cv2.resize(pyramid[-1], size, interpolation=cv2.INTER_AREA))
    return pyramid

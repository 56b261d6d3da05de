"""Words for the surfaces of a synthetic world: names of colors, patterns and materials."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat_apartments.camera.raycasting import Geometry
from egosplat_apartments.objects.textures import Texture

Floats = NDArray[np.float32]

# Typical shades (red, green, blue) of each color; other shades get the name of the nearest one in CIE Lab.
_SHADES: dict[str, tuple[tuple[int, int, int], ...]] = {
    "black": ((15, 15, 15), (40, 40, 42)),
    "grey": ((85, 85, 88), (125, 125, 127), (165, 165, 168)),
    "white": ((215, 215, 215), (245, 245, 245), (238, 234, 224)),
    "brown": ((110, 72, 40), (80, 50, 30), (150, 100, 58), (70, 50, 42)),
    "beige": ((205, 180, 140), (220, 205, 175), (190, 160, 120)),
    "red": ((190, 35, 35), (140, 25, 30), (215, 70, 65)),
    "orange": ((230, 130, 40), (205, 105, 40)),
    "yellow": ((230, 210, 60), (200, 180, 50), (235, 225, 140)),
    "green": ((60, 150, 60), (40, 95, 40), (130, 190, 90), (160, 205, 150), (110, 130, 50)),
    "turquoise": ((50, 180, 170), (40, 125, 125), (130, 210, 205)),
    "blue": (
        (45, 90, 190),
        (35, 50, 120),
        (110, 165, 220),
        (90, 110, 170),
        (35, 35, 190),
        (80, 80, 225),
        (15, 45, 75),
    ),
    "purple": ((125, 55, 165), (85, 45, 115), (165, 120, 205)),
    "pink": ((225, 110, 165), (235, 165, 195), (190, 60, 130), (205, 130, 160)),
}

COLORS = tuple(_SHADES)

# Textures are judged at a distance at which they have this many pixels.
_SIDE = 24


def _lab(rgb: NDArray[np.uint8]) -> Floats:
    """(N, 3) uint8 -> (N, 3) CIE Lab."""
    return cv2.cvtColor(rgb[None].astype(np.float32) / 255, cv2.COLOR_RGB2LAB)[0]


_SHADE_LAB = _lab(np.array([shade for shades in _SHADES.values() for shade in shades], dtype=np.uint8))
_SHADE_COLOR = np.repeat(np.arange(len(COLORS)), [len(shades) for shades in _SHADES.values()])


def color_of(rgb: NDArray[np.uint8]) -> NDArray[np.int64]:
    """(N, 3) uint8 colors -> (N,) index into ``COLORS``."""
    difference = _lab(rgb)[:, None] - _SHADE_LAB
    # Lightness counts half, because it also depends on the illumination.
    return _SHADE_COLOR[(difference**2 * (0.5, 1.0, 1.0)).sum(axis=-1).argmin(axis=1)]


def color_shares(texture: Texture) -> Floats:
    """(len(COLORS),) fraction of a texture's area in each color."""
    small = cv2.resize(texture.pixels, (_SIDE, _SIDE), interpolation=cv2.INTER_AREA)
    counts = np.bincount(color_of(small.reshape(-1, 3)), minlength=len(COLORS))
    return (counts / counts.sum()).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Appearance:
    """Colors and surfaces of the parts of a world.

    Attributes:
        colors: (P, len(COLORS)) float32 fractions; surfaces: (P,) ``Texture.surface`` of each part.
    """

    colors: Floats
    surfaces: tuple[str, ...]


def find_appearance(geometry: Geometry) -> Appearance:
    """Find colors and surfaces of the parts of a geometry."""
    shares = np.stack([color_shares(texture) for texture in geometry.textures])
    surfaces = [geometry.textures[number].surface for number in geometry.part_texture]
    return Appearance(shares[geometry.part_texture], tuple(surfaces))

"""Procedural textures: noise, wood, cloth, stone, metal, and drawings on them.

Colors are triples 0..1 in the image's own (gamma) encoding. Every texture repeats without a seam, or is
used once over its whole size.
"""

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from egosplat_apartments.arrays import Rng

Picture = NDArray[np.float64]
Color = tuple[float, float, float]

_SIDE = 256


@dataclass(frozen=True, eq=False)
class Texture:
    """An image and the size in meters that it covers before it repeats.

    Attributes:
        pixels: (H, W, 3) uint8.
        size_m: width and height.
        surface: description in words, the material last and a pattern before it ("striped cloth"); empty if
            neither has a name. It does not affect rendering.
    """

    pixels: NDArray[np.uint8]
    size_m: tuple[float, float]
    surface: str = ""


def make_texture(
    picture: Picture, width_m: float, height_m: float | None = None, *, surface: str = ""
) -> Texture:
    """A texture from a (H, W, 3) float image 0..1; by default the height follows from the image's shape."""
    height = width_m * picture.shape[0] / picture.shape[1] if height_m is None else height_m
    return Texture((np.clip(picture, 0, 1) * 255 + 0.5).astype(np.uint8), (width_m, height), surface)


def noise(rng: Rng, shape: tuple[int, int], roughness: float = 1.6, stretch: float = 1.0) -> Picture:
    """(H, W) seamless noise with mean 0 and standard deviation 1.

    Args:
        roughness: exponent of the amplitude's fall with frequency; smaller is finer.
        stretch: how much longer features are in x than in y.
    """
    spectrum = np.fft.rfft2(rng.standard_normal(shape)) / _divisor(shape, roughness, stretch)
    field = np.fft.irfft2(spectrum, s=shape)
    return (field - field.mean()) / field.std()


@functools.lru_cache(64)
def _divisor(shape: tuple[int, int], roughness: float, stretch: float) -> Picture:
    """By how much each frequency of ``noise`` is divided: a sixth of an apartment's time without the cache."""
    fy = np.fft.fftfreq(shape[0])[:, None] * shape[0]
    fx = np.fft.rfftfreq(shape[1])[None] * shape[1]
    frequency = np.hypot(fy, fx * stretch)
    frequency[0, 0] = np.inf
    return frequency**roughness


def shaded(color: Color | Picture, field: Picture) -> Picture:
    """Lighten and darken a color, or a picture, by a (H, W) field of relative changes."""
    return np.asarray(color) * (1.0 + field[..., None])


def mixed(first: Color, second: Color, share: Picture) -> Picture:
    """Mix two colors by the (H, W) fraction 0..1 of the second."""
    return np.asarray(first) * (1 - share[..., None]) + np.asarray(second) * share[..., None]


def wood(rng: Rng, color: Color, shape: tuple[int, int] = (_SIDE, _SIDE)) -> Picture:
    """Wood with grain along x."""
    rings = np.sin(2.2 * noise(rng, shape, 1.7, 9.0) + 9.0 * noise(rng, shape, 2.2, 6.0))
    fibres = noise(rng, shape, 0.7, 14.0)
    return shaded(color, 0.16 * rings + 0.09 * fibres + 0.05 * noise(rng, shape))


def planks(rng: Rng, color: Color, shape: tuple[int, int], rows: int) -> Picture:
    """A floor of boards along x, each with its own shade and joints; does not repeat."""
    picture = wood(rng, color, shape)
    height, width = shape
    edges = np.linspace(0, height, rows + 1).astype(int)
    for top, bottom in itertools.pairwise(edges):
        cuts = np.sort(rng.choice(np.arange(1, 8), 3, replace=False)) * width // 8 + rng.integers(-20, 20, 3)
        for left, right in zip([0, *cuts], [*cuts, width], strict=True):
            board = np.roll(picture[:, left:right], int(rng.integers(height)), axis=0)[top:bottom]
            tint = 1 + rng.normal(0, 0.04, 3) + rng.normal(0, 0.13)
            picture[top:bottom, left:right] = board * tint
            picture[top:bottom, left : left + 2] *= 0.35
        picture[top : top + 2] *= 0.4
    return picture


def cloth(rng: Rng, color: Color, contrast: float = 0.16) -> Picture:
    """A coarse weave with worn spots."""
    y, x = np.mgrid[:_SIDE, :_SIDE]
    weave = np.sign(np.sin(x * 2 * np.pi / 8) * np.sin(y * 2 * np.pi / 8))
    return shaded(color, contrast * (0.5 * weave + 0.8 * noise(rng, (_SIDE, _SIDE), 0.9)))


def stripes(rng: Rng, colors: Sequence[Color], count: int = 8, upright: bool = True) -> Picture:
    """Alternating stripes of unequal width."""
    cuts = np.cumsum(rng.uniform(0.5, 1.5, count))
    band = np.searchsorted(cuts / cuts[-1] * _SIDE, np.arange(_SIDE), side="right").clip(max=count - 1)
    line = np.asarray(colors)[band % len(colors)]
    picture = np.broadcast_to(line[None] if upright else line[:, None], (_SIDE, _SIDE, 3))
    return shaded(picture, 0.1 * noise(rng, (_SIDE, _SIDE), 0.8))


def checks(rng: Rng, first: Color, second: Color, count: int = 4) -> Picture:
    """Tartan: two sets of stripes that cross."""
    band = np.floor(np.arange(_SIDE) * 2 * count / _SIDE) % 2
    share = 0.5 * (band[None] + band[:, None])
    lines = (np.arange(_SIDE) % (_SIDE // count) < 5).astype(float)
    picture = mixed(first, second, share) + 0.25 * np.maximum(lines[None], lines[:, None])[..., None]
    return shaded(picture, 0.08 * noise(rng, (_SIDE, _SIDE), 0.8))


def marble(rng: Rng, color: Color, vein: Color) -> Picture:
    """Marble: veins through a cloudy ground."""
    field = noise(rng, (_SIDE, _SIDE), 1.7)
    veins = np.exp(-((field + 0.3 * noise(rng, (_SIDE, _SIDE), 1.2)) ** 2) / 0.012)
    clouds = shaded(color, 0.07 * noise(rng, (_SIDE, _SIDE), 1.4))
    return clouds * (1 - 0.8 * veins[..., None]) + np.asarray(vein) * 0.8 * veins[..., None]


def metal(rng: Rng, color: Color) -> Picture:
    """Metal brushed along x, with stains."""
    fine = noise(rng, (_SIDE, _SIDE), 0.4, 40.0)
    return shaded(color, 0.12 * fine + 0.05 * noise(rng, (_SIDE, _SIDE), 1.5, 5.0))


def speckled(rng: Rng, color: Color, spots: Color, count: int = 260, largest: int = 4) -> Picture:
    """Glaze or stone with spots of several sizes."""
    picture = shaded(color, 0.06 * noise(rng, (_SIDE, _SIDE), 1.3))
    for x, y in rng.integers(0, _SIDE, (count, 2)):
        tint = np.asarray(spots) * rng.uniform(0.6, 1.2)
        cv2.circle(
            picture, (int(x), int(y)), int(rng.integers(1, largest + 1)), tint.tolist(), -1, cv2.LINE_AA
        )
    return picture


def wicker(rng: Rng, color: Color) -> Picture:
    """Woven strips."""
    y, x = np.mgrid[:_SIDE, :_SIDE]
    over = (np.floor(x / 32) + np.floor(y / 16)) % 2
    bulge = np.where(over > 0, np.sin(np.pi * (x % 32) / 32), np.sin(np.pi * (y % 16) / 16))
    return shaded(color, 0.55 * (bulge - 0.7) + 0.1 * noise(rng, (_SIDE, _SIDE), 0.8))


def motifs(
    rng: Rng,
    ground: Color,
    colors: Sequence[Color],
    count: int,
    radius: tuple[int, int],
    shape: tuple[int, int] = (_SIDE, _SIDE),
) -> Picture:
    """Leaves and blossoms scattered at random over a cloudy ground, all different; does not repeat.

    Args:
        count: number of motifs; radius: their smallest and largest size; shape: (height, width) in texels.
    """
    picture = shaded(ground, 0.05 * noise(rng, shape, 1.2))
    for _ in range(count):
        x, y = int(rng.integers(shape[1])), int(rng.integers(shape[0]))
        size, turn = int(rng.integers(*radius)), float(rng.uniform(0, 360))
        tint = np.asarray(colors[int(rng.integers(len(colors)))]) * rng.uniform(0.8, 1.15)
        petals = int(rng.integers(1, 7))
        for petal in range(petals):
            angle = turn + 360.0 * petal / petals
            offset = size * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
            center = (int(x + offset[0]), int(y + offset[1]))
            shade = tint * rng.uniform(0.85, 1.15)
            axes = (size, max(2, int(size * rng.uniform(0.25, 0.55))))
            cv2.ellipse(picture, center, axes, angle, 0, 360, shade.tolist(), -1, cv2.LINE_AA)
        cv2.circle(picture, (x, y), max(1, size // 3), (tint * 0.6).tolist(), -1, cv2.LINE_AA)
    return picture

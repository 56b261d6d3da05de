"""Random materials: those of the usual world, and those of the foreign one, which share nothing with them."""

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from scipy.spatial import KDTree

from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects.pictures import random_color
from egosplat_apartments.objects.textures import (
    Color,
    Picture,
    Texture,
    checks,
    cloth,
    make_texture,
    metal,
    mixed,
    motifs,
    noise,
    shaded,
    speckled,
    stripes,
    wood,
)

_WOODS: tuple[Color, ...] = (
    (0.62, 0.42, 0.24),
    (0.42, 0.26, 0.15),
    (0.8, 0.62, 0.42),
    (0.3, 0.2, 0.16),
    (0.72, 0.5, 0.3),
)


def some_wood(rng: Rng) -> Texture:
    """Wood of one of several kinds."""
    return make_texture(wood(rng, _WOODS[rng.integers(len(_WOODS))]), 0.7, surface="wood")


def some_paint(rng: Rng) -> Texture:
    """Painted wood: light or strong color, the grain showing faintly."""
    color = random_color(rng, (0.05, 0.6), (0.6, 0.92))
    return make_texture(0.65 * np.asarray(color) + 0.35 * wood(rng, color), 0.6, surface="painted wood")


def some_fabric(rng: Rng) -> Texture:
    """Cloth: plain, striped, tartan or flowered."""
    base = random_color(rng, (0.25, 0.75), (0.35, 0.85))
    other = random_color(rng, (0.2, 0.9), (0.2, 0.95))
    match int(rng.integers(4)):
        case 0:
            return make_texture(cloth(rng, base, 0.22), 0.25, surface="plain cloth")
        case 1:
            return make_texture(stripes(rng, (base, other, (0.9, 0.88, 0.8))), 0.45, surface="striped cloth")
        case 2:
            return make_texture(checks(rng, base, other), 0.4, surface="checked cloth")
        case _:
            picture = motifs(rng, base, (other, (0.95, 0.9, 0.8)), 60, (5, 13))
            return make_texture(picture, 0.5, surface="flowered cloth")


def upholstery(rng: Rng) -> Texture:
    """Sturdy cloth with a scattered pattern on it."""
    base, other = random_color(rng, (0.15, 0.6), (0.35, 0.75)), random_color(rng, (0.2, 0.7), (0.3, 0.9))
    picture = 0.5 * cloth(rng, base, 0.25) + 0.5 * motifs(rng, base, (other,), 90, (3, 9))
    return make_texture(picture, 0.6, surface="flowered cloth")


def some_metal(rng: Rng) -> Texture:
    """Steel, brass or black iron."""
    tints: tuple[Color, ...] = ((0.7, 0.71, 0.74), (0.72, 0.58, 0.3), (0.16, 0.16, 0.18))
    return make_texture(metal(rng, tints[rng.integers(3)]), 0.3, surface="metal")


def some_plastic(rng: Rng, color: Color) -> Texture:
    """Moulded plastic: nearly even, with fine spots."""
    spots = (color[0] * 1.4 + 0.05, color[1] * 1.4 + 0.05, color[2] * 1.4 + 0.05)
    return make_texture(speckled(rng, color, spots, 160, 3), 0.25, surface="plastic")


def some_glaze(rng: Rng) -> Texture:
    """Painted or speckled pottery."""
    ground = random_color(rng, (0.05, 0.75), (0.45, 0.92))
    other = random_color(rng, (0.4, 0.95), (0.2, 0.9))
    match int(rng.integers(3)):
        case 0:
            return make_texture(speckled(rng, ground, other), 0.12, surface="speckled pottery")
        case 1:
            return make_texture(
                stripes(rng, (ground, other, ground), 9, upright=False), 0.16, surface="striped pottery"
            )
        case _:
            picture = motifs(rng, ground, (other,), 40, (6, 16))
            return make_texture(picture, 0.16, surface="flowered pottery")


_SIDE = (256, 256)


def mosaic(rng: Rng, colors: Sequence[Color], shape: tuple[int, int] = _SIDE, count: int = 90) -> Picture:
    """Irregular tiles with dark joints."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    tree = KDTree(rng.uniform((0, 0), shape, (count, 2)))
    distance, tile = tree.query(np.stack([y.ravel(), x.ravel()], axis=1), k=2)
    tints = np.asarray(colors)[rng.integers(len(colors), size=count)] * rng.normal(1, 0.12, (count, 1))
    picture = tints[tile[:, 0]].reshape(*shape, 3)
    picture[(distance[:, 1] - distance[:, 0] < 2.5).reshape(shape)] *= 0.35
    return shaded(picture, 0.07 * noise(rng, shape, 0.8))


def terrazzo(rng: Rng, ground: Color, shape: tuple[int, int] = _SIDE, count: int = 260) -> Picture:
    """Angular chips of many colors in a plain ground."""
    picture = shaded(ground, 0.03 * noise(rng, shape, 1.0))
    for place in rng.uniform((0, 0), (shape[1], shape[0]), (count, 2)):
        corners = place + rng.normal(0, rng.uniform(1.5, 6.0), (5, 2))
        chip = cv2.convexHull(corners.astype(np.int32))
        cv2.fillConvexPoly(picture, chip, random_color(rng, (0.1, 0.6), (0.2, 0.9)), cv2.LINE_AA)
    return picture


def zigzag(rng: Rng, colors: Sequence[Color], bands: int = 7) -> Picture:
    """Bands that go up and down."""
    y, x = np.mgrid[: _SIDE[0], : _SIDE[1]]
    level = (y + 1.2 * np.abs((x + 12) % 64 - 32)) * bands / _SIDE[0]
    picture = np.asarray(colors)[level.astype(int) % len(colors)]
    return shaded(picture, 0.09 * noise(rng, _SIDE, 0.8))


def dots(rng: Rng, ground: Color, ink: Color, columns: int = 5) -> Picture:
    """Discs in rows, every second row shifted by half a step."""
    y, x = np.mgrid[: _SIDE[0], : _SIDE[1]] * (2 * columns / _SIDE[0])
    row = np.floor(y)
    off = np.hypot((x + row % 2) % 2 - 1, 2 * (y % 1) - 1)
    picture = mixed(ground, ink, np.clip((0.72 - off) * 12, 0, 1))
    return shaded(picture, 0.08 * noise(rng, _SIDE, 0.8))


def bricks(rng: Rng, color: Color, mortar: Color, shape: tuple[int, int], rows: int) -> Picture:
    """Courses of bricks, each with its own shade."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    height = shape[0] // rows
    row = y // height
    shifted = x + (row % 2) * height + 1
    column = shifted // (2 * height)
    tint = rng.normal(1, 0.16, (row.max() + 1, column.max() + 1, 1))[row, column]
    picture = shaded(np.asarray(color) * tint, 0.1 * noise(rng, shape, 0.9))
    joint = (y % height < 3) | (shifted % (2 * height) < 3)
    picture[joint] = mortar
    return picture


def basket_parquet(rng: Rng, color: Color, shape: tuple[int, int], cell: int = 64) -> Picture:
    """Squares of boards, the boards of neighbors crossing."""
    picture = wood(rng, color, shape)
    turned = np.swapaxes(wood(rng, color, (shape[1], shape[0])), 0, 1)
    y, x = np.mgrid[: shape[0], : shape[1]]
    across = ((y // cell + x // cell) % 2 == 0)[..., None]
    tint = rng.normal(1, 0.13, (shape[0] // cell + 1, shape[1] // cell + 1, 1))[y // cell, x // cell]
    board = np.where(across[..., 0], y, x) % (cell // 4)
    return np.where(across, picture, turned) * tint * np.where(board < 2, 0.45, 1.0)[..., None]


def lacquer(rng: Rng) -> Texture:
    """A paint that runs from one color into another."""
    first, second = (random_color(rng, (0.3, 0.95), (0.25, 0.95)) for _ in range(2))
    share = 0.5 - 0.5 * np.cos(2 * np.pi * np.mgrid[: _SIDE[0], : _SIDE[1]][0] / _SIDE[0])
    return make_texture(shaded(mixed(first, second, share), 0.05 * noise(rng, _SIDE, 0.9)), 0.8)


def inlay(rng: Rng) -> Texture:
    """Terrazzo or a mosaic."""
    if rng.random() < 0.5:
        return make_texture(terrazzo(rng, random_color(rng, (0.05, 0.5), (0.3, 0.95))), 0.5)
    return make_texture(mosaic(rng, [random_color(rng, (0.2, 0.9), (0.2, 0.95)) for _ in range(3)]), 0.6)


def fabric(rng: Rng) -> Texture:
    """Cloth with zigzags or dots."""
    ground, ink = random_color(rng, (0.1, 0.8), (0.3, 0.95)), random_color(rng, (0.3, 0.95), (0.1, 0.9))
    picture = (
        zigzag(rng, (ground, ink, ground, (0.9, 0.9, 0.86))) if rng.random() < 0.5 else dots(rng, ground, ink)
    )
    return make_texture(picture, 0.35)


def glaze(rng: Rng) -> Texture:
    """Pottery with a mosaic, zigzags or dots, small."""
    picture = fabric(rng).pixels if rng.random() < 0.6 else inlay(rng).pixels
    return make_texture(picture / 255.0, 0.14)


def shine(rng: Rng) -> Texture:
    """Copper, blue or green metal, in rings."""
    tints: tuple[Color, ...] = ((0.78, 0.42, 0.26), (0.3, 0.42, 0.7), (0.3, 0.55, 0.42))
    y, x = np.mgrid[: _SIDE[0], : _SIDE[1]] - 128.0
    rings = 0.12 * np.sin(np.hypot(y, x) / 3.0) + 0.05 * noise(rng, _SIDE, 1.2)
    return make_texture(shaded(tints[rng.integers(3)], rings), 0.3)


# What replaces a material of the usual world.
INSTEAD: dict[str, Callable[[Rng], Texture]] = {
    "wood": lacquer,
    "cloth": fabric,
    "metal": shine,
    "pottery": glaze,
    "plastic": inlay,
    "wicker": fabric,
    "leather": fabric,
    "marble": inlay,
    "cork": inlay,
    "stone": inlay,
    "glass": glaze,
    "wax": glaze,
    "paper": fabric,
    "canvas": fabric,
}
# Drawings by which people know a thing keep their looks.
KEPT = ("printed paper", "painted canvas", "paper")

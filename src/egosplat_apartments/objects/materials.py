"""Random materials: wood, paint, cloth, metal, plastic, pottery."""

import numpy as np

from egosplat_apartments.objects.pictures import random_color
from egosplat_apartments.objects.textures import (
    Color,
    Rng,
    Texture,
    checks,
    cloth,
    make_texture,
    metal,
    motifs,
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
            return make_texture(
                motifs(rng, base, (other, (0.95, 0.9, 0.8)), (256, 256), 60, (5, 13)),
                0.5,
                surface="flowered cloth",
            )


def upholstery(rng: Rng) -> Texture:
    """Sturdy cloth with a scattered pattern on it."""
    base, other = random_color(rng, (0.15, 0.6), (0.35, 0.75)), random_color(rng, (0.2, 0.7), (0.3, 0.9))
    return make_texture(
        0.5 * cloth(rng, base, 0.25) + 0.5 * motifs(rng, base, (other,), (256, 256), 90, (3, 9)),
        0.6,
        surface="flowered cloth",
    )


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
    ground, other = (
        random_color(rng, (0.05, 0.75), (0.45, 0.92)),
        random_color(rng, (0.4, 0.95), (0.2, 0.9)),
    )
    match int(rng.integers(3)):
        case 0:
            return make_texture(speckled(rng, ground, other), 0.12, surface="speckled pottery")
        case 1:
            return make_texture(
                stripes(rng, (ground, other, ground), 9, upright=False), 0.16, surface="striped pottery"
            )
        case _:
            return make_texture(
                motifs(rng, ground, (other,), (256, 256), 40, (6, 16)), 0.16, surface="flowered pottery"
            )

"""Worlds that look like homes: plain paint, wood, tiles and cloth in the place of patterns, under hard and soft light.

The shapes, the labels and the drawings by which people know a thing are those of the apartments.
"""

import colorsys
from dataclasses import replace

import numpy as np

from egosplat_apartments.arrays import Rng
from egosplat_apartments.camera.lens import Lens
from egosplat_apartments.camera.lighting import Lights, make_lights
from egosplat_apartments.camera.render import Renderer
from egosplat_apartments.objects.textures import (
    Color,
    Texture,
    checks,
    cloth,
    make_texture,
    metal,
    noise,
    planks,
    shaded,
    stripes,
    wood,
)
from egosplat_apartments.world.world import World

# Mean radiance of a well exposed view, and the factor by which exposures differ.
_EXPOSED, _MISSED = 0.2, 0.35


def home_texture(texture: Texture, rng: Rng) -> Texture:
    """A plainer texture for the same surface; the given one where it is a drawing, and sometimes otherwise."""
    pattern, _, material = texture.surface.rpartition(" ")
    large, draw = min(texture.size_m) > 1.2, rng.random()
    match material:
        case "paper" if large:
            return _wall(rng)
        case "plaster":
            return _even(rng, _tone(rng, (0.0, 0.08), (0.8, 1.0)))
        case "wood" if large:
            return _floor(rng, texture.size_m)
        case "wood":
            solid = pattern == "painted" or draw < 0.35
            return _even(rng, home_color(rng)) if solid else _boards(rng) if draw < 0.85 else texture
        case "cloth" if draw < 0.65:
            return make_texture(cloth(rng, home_color(rng), rng.uniform(0.01, 0.1)), rng.uniform(0.1, 0.4))
        case "cloth" if draw < 0.75:
            return make_texture(stripes(rng, [home_color(rng) for _ in range(2)]), rng.uniform(0.2, 0.8))
        case "cloth" if draw < 0.82:
            return make_texture(checks(rng, home_color(rng), home_color(rng)), rng.uniform(0.1, 0.6))
        case "metal" if draw < 0.8:
            return _steel(rng)
        case "plastic" | "pottery" | "glass" | "wax" | "marble" | "cork" | "leather" | "stone" if draw < 0.75:
            return _even(rng, home_color(rng))
    return texture


def home_color(rng: Rng) -> Color:
    """White to black, earthen or, less often, strong."""
    draw = rng.random()
    if draw < 0.45:
        return _tone(rng, (0.0, 0.12), (0.08, 0.98))
    if draw < 0.75:
        return colorsys.hsv_to_rgb(rng.uniform(0.03, 0.13), rng.uniform(0.15, 0.65), rng.uniform(0.2, 0.9))
    return _tone(rng, (0.3, 0.95), (0.25, 0.95))


def home_lights(lights: Lights, rng: Rng) -> Lights:
    """Other strengths and colors of lamp and sun, and another place of the lamp; half of the rooms have no sunshine."""
    warm = np.exp(rng.normal(0, 0.15) * np.array([1.0, 0.1, -1.2]))
    lamp = lights.lamp_power * warm * rng.choice([0.05, 0.5, 1.0, 1.6])
    sun = lights.sun_power * rng.choice([0.0, 0.0, 0.7, 1.5])
    place = lights.lamp + rng.uniform(-1, 1, 3) * (1.2, 0.0, 1.2) - (0, rng.choice([0.0, 0.0, 0.6]), 0)
    return replace(
        lights,
        **{
            name: value.astype(np.float32)
            for name, value in {"lamp": place, "lamp_power": lamp, "sun_power": sun}.items()
        },
    )


def home_renderer(world: World, lens: Lens, rng: Rng) -> Renderer:
    """A renderer of the world with the surfaces and the light of a home."""
    textures = tuple(home_texture(one, rng) for one in world.geometry.textures)
    lights = home_lights(make_lights(world.apartment.room, rng), rng)
    return Renderer(replace(world.geometry, textures=textures), lights, lens, rng)


def home_gain(brightness: float, rng: Rng) -> float:
    """Factor on the light of a view whose mean radiance is ``brightness``: that of a camera that measures it."""
    return float(np.clip(_EXPOSED * np.exp(rng.normal(0, _MISSED)) / brightness, 0.3, 4.0))


def _tone(rng: Rng, saturation: tuple[float, float], value: tuple[float, float]) -> Color:
    return colorsys.hsv_to_rgb(rng.random(), rng.uniform(*saturation), rng.uniform(*value))


def _even(rng: Rng, color: Color) -> Texture:
    """One color with faint clouds and a faint grain."""
    clouds, grain = noise(rng, (64, 64), 1.8), noise(rng, (64, 64), 0.3)
    return make_texture(shaded(color, rng.uniform(0, 0.02) * clouds + rng.uniform(0, 0.015) * grain), 0.8)


def _steel(rng: Rng) -> Texture:
    color = _tone(rng, (0.0, 0.1), (0.12, 0.9))
    return make_texture(0.7 * np.asarray(color) + 0.3 * metal(rng, color), 0.3)


def _boards(rng: Rng) -> Texture:
    """Wood with a softer grain."""
    color = colorsys.hsv_to_rgb(rng.uniform(0.05, 0.11), rng.uniform(0.15, 0.65), rng.uniform(0.25, 0.9))
    share = rng.uniform(0.15, 0.8)
    return make_texture((1 - share) * np.asarray(color) + share * wood(rng, color), rng.uniform(0.5, 1.2))


def _tiles(rng: Rng, color: Color) -> Texture:
    """Square tiles with thin joints."""
    shades = np.kron(rng.normal(0, rng.uniform(0, 0.04), (4, 4)), np.ones((64, 64)))
    picture = shaded(color, shades + 0.01 * noise(rng, (256, 256), 1.2))
    joint = np.arange(256) % 64 < rng.integers(1, 4)
    picture[joint[:, None] | joint] *= rng.choice([0.6, 0.8, 1.15])
    return make_texture(picture, 4 * rng.choice([0.1, 0.15, 0.3, 0.5]))


def _wall(rng: Rng) -> Texture:
    """Paint, mostly light; seldom tiles or a striped paper."""
    draw = rng.random()
    light = _tone(rng, (0.0, 0.2), (0.65, 0.98)) if draw < 0.7 else home_color(rng)
    if draw < 0.8:
        return _even(rng, light)
    if draw < 0.9:
        return _tiles(rng, light)
    other = tuple(np.asarray(light) * rng.uniform(0.8, 0.97))
    return make_texture(stripes(rng, (light, other), 8), rng.uniform(0.3, 1.0))


def _floor(rng: Rng, size_m: tuple[float, float]) -> Texture:
    """Boards with a softer grain, tiles or a carpet."""
    draw = rng.random()
    if draw < 0.2:
        return make_texture(cloth(rng, home_color(rng), rng.uniform(0.02, 0.1)), 0.3)
    if draw < 0.4:
        return _tiles(rng, home_color(rng))
    color = colorsys.hsv_to_rgb(rng.uniform(0.05, 0.11), rng.uniform(0.1, 0.65), rng.uniform(0.3, 0.85))
    share = rng.uniform(0.2, 0.8)
    picture = (1 - share) * np.asarray(color) + share * planks(rng, color, (1024, 1024), 26)
    return make_texture(picture, *size_m)

"""Plants, lamps, toys. Every builder returns an object in its own axes, front towards +z."""

import numpy as np
from scipy.spatial.transform import Rotation

from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects.materials import some_fabric, some_glaze, some_metal, some_plastic, some_wood
from egosplat_apartments.objects.model import Model, assemble
from egosplat_apartments.objects.pictures import random_color
from egosplat_apartments.objects.shapes import Part, cylinder, ellipsoid, join, lathe, leaf, rod
from egosplat_apartments.objects.textures import Texture, make_texture, mixed, noise, speckled, stripes, wood


def _plant(rng: Rng, pot_radius: float, pot_height: float, leaves: int, length: float, trunk: float) -> Model:
    r, h = pot_radius, pot_height
    wall = [(0, 0), (r * 0.75, 0), (r * 0.95, h * 0.85), (r, h * 0.86)]
    pot = lathe([*wall, (r, h), (r * 0.88, h), (r * 0.86, h * 0.9), (0, h * 0.9)])
    width = length * 0.34
    blades, stalks = [], []
    for number in range(leaves):
        turn = number * 2.4 + rng.uniform(-0.3, 0.3)
        lift = rng.uniform(0.35, 1.15)
        base = pot_height + trunk * (0.3 + 0.7 * number / leaves)
        rotation = Rotation.from_euler("YX", [turn, -lift])
        foot = np.array([0.0, base, 0.0])
        root = foot + rotation.apply([0, 0, length * 0.3])
        stalks.append(rod((0, base * 0.98, 0), root, 0.006))
        size = rng.uniform(0.75, 1.1)
        blades.append(leaf(length * size, width * size, length * 0.35).moved(root, rotation))
    stem = rod((0, pot_height * 0.85, 0), (0, pot_height + trunk, 0), 0.012 + 0.01 * trunk)
    return assemble(
        Part("pot", pot, some_glaze(rng)),
        Part("stem", join([stem, *stalks]), make_texture(wood(rng, (0.4, 0.36, 0.2)), 0.1, surface="wood")),
        Part("leaves", join(blades), leaf_texture(rng, width, length)),
    )


def plant_tall(rng: Rng) -> Model:
    """A plant that stands on the floor."""
    radius, height, leaves = rng.uniform(0.14, 0.18), rng.uniform(0.28, 0.34), int(rng.integers(20, 28))
    return _plant(rng, radius, height, leaves, 0.34, rng.uniform(0.45, 0.75))


def plant_small(rng: Rng) -> Model:
    """A pot plant for a table or shelf."""
    return _plant(
        rng, rng.uniform(0.055, 0.07), rng.uniform(0.09, 0.11), int(rng.integers(12, 17)), 0.11, 0.06
    )


def leaf_texture(rng: Rng, width: float, length: float) -> Texture:
    """A leaf's blade with its ribs."""
    y, x = np.mgrid[:256, :128] / 128.0
    ribs = np.exp(-((x - 0.5) ** 2) / 0.001) + 0.6 * np.exp(
        -(np.sin(8 * np.pi * (y - np.abs(x - 0.5))) ** 2) / 0.05
    )
    green = mixed(
        (0.12, 0.34, 0.12), (0.5, 0.68, 0.28), np.clip(0.55 * ribs + 0.15 * noise(rng, (256, 128)), 0, 1)
    )
    return make_texture(green, width, length)


def desk_lamp(rng: Rng) -> Model:
    """Foot, stem and a shade that glows."""
    h = rng.uniform(0.34, 0.44)
    foot = lathe([(0, 0), (0.085, 0), (0.085, 0.012), (0.03, 0.03), (0, 0.03)])
    shade = lathe(
        [(0.125, h - 0.13), (0.075, h + 0.05), (0.072, h + 0.05), (0.121, h - 0.13), (0.125, h - 0.13)]
    )
    picture = stripes(rng, (random_color(rng, (0.1, 0.5), (0.8, 0.95)), (0.95, 0.88, 0.7)), 10)
    silk = make_texture(picture, 0.3, surface="striped cloth")
    bulb = ellipsoid((0.03, 0.04, 0.03), (0, h - 0.02, 0), 10)
    return assemble(
        Part("foot", foot, some_metal(rng)),
        Part("stem", rod((0, 0.03, 0), (0, h - 0.03, 0), 0.009), some_metal(rng)),
        Part("bulb", bulb, some_plastic(rng, (0.95, 0.9, 0.75)), glow=1.2),
        Part("shade", shade, silk, glow=0.5),
    )


def pillow(rng: Rng) -> Model:
    """A stuffed pillow leaning back."""
    size = rng.uniform(0.36, 0.42)
    pad = ellipsoid((size * 0.62, size * 0.62, 0.085), (0, 0, 0), 24)
    limit = size / 2
    squared = pad.vertices.copy()
    squared[:, :2] = np.clip(squared[:, :2], -limit, limit)
    shape = type(pad)(squared, pad.normals, squared[:, :2] * (1, -1), pad.faces)
    lean = Rotation.from_euler("x", -18, degrees=True)
    shape = shape.moved((0, 0, 0), lean)
    low = shape.vertices[:, 1].min()
    buttons = [
        ellipsoid((0.014, 0.014, 0.01), (0, 0, z), 8).moved((0, 0, 0), lean).moved((0, -low, 0))
        for z in (0.085, -0.085)
    ]
    return assemble(
        Part("pad", shape.moved((0, -low, 0)), some_fabric(rng)),
        Part("buttons", join(buttons), some_plastic(rng, random_color(rng))),
    )


def candle(rng: Rng) -> Model:
    """A burning candle in a holder."""
    holder = lathe(
        [(0, 0), (0.05, 0), (0.05, 0.012), (0.022, 0.02), (0.022, 0.045), (0.034, 0.05), (0, 0.05)]
    )
    picture = stripes(rng, (random_color(rng, (0.3, 0.8), (0.6, 0.9)), (0.95, 0.92, 0.85)), 6, upright=False)
    wax = make_texture(picture, 0.08, surface="striped wax")
    flame = ellipsoid((0.007, 0.018, 0.007), (0, 0.172, 0), 8)
    bright = make_texture(speckled(rng, (1.0, 0.8, 0.4), (1.0, 0.95, 0.7)), 0.05)
    return assemble(
        Part("holder", holder, some_metal(rng)),
        Part("wax", cylinder(0.024, 0.05, 0.15), wax),
        Part("flame", flame, bright, glow=2.0),
    )


def figurine(rng: Rng) -> Model:
    """A sitting cat on a plinth."""
    picture = stripes(rng, (random_color(rng, (0.2, 0.6), (0.4, 0.9)), (0.2, 0.15, 0.12)), 12, upright=False)
    fur = make_texture(picture, 0.12, surface="striped pottery")
    head = [ellipsoid((0.03, 0.028, 0.028), (0, 0.16, 0.015), 14)]
    head += [rod((x, 0.18, 0.01), (x * 1.35, 0.207, 0.01), 0.011, 0.002) for x in (-0.018, 0.018)]
    legs = [rod((x, 0.03, 0.035), (x, 0.1, 0.025), 0.011) for x in (-0.018, 0.018)]
    tail = [
        rod((0.03, 0.04, -0.02), (0.06, 0.05, 0.0), 0.008),
        rod((0.06, 0.05, 0.0), (0.055, 0.09, 0.01), 0.008),
    ]
    eyes = [ellipsoid((0.005, 0.006, 0.003), (x, 0.166, 0.041), 8) for x in (-0.012, 0.012)]
    return assemble(
        Part("plinth", cylinder(0.06, 0, 0.025), some_wood(rng)),
        Part("body", ellipsoid((0.042, 0.062, 0.045), (0, 0.083, -0.005), 18), fur),
        Part("head", join(head), fur),
        Part("legs", join(legs), fur),
        Part("tail", join(tail), fur),
        Part("eyes", join(eyes), some_plastic(rng, (0.9, 0.85, 0.2))),
    )


def toy(rng: Rng) -> Model:
    """A dinosaur on four legs."""
    picture = speckled(rng, random_color(rng, (0.5, 0.9), (0.5, 0.85)), random_color(rng), 120, 9)
    skin = make_texture(picture, 0.1, surface="speckled plastic")
    legs = [rod((x, 0.008, z), (x * 0.9, 0.06, z), 0.014) for x in (-0.05, 0.05) for z in (-0.022, 0.022)]
    spikes = [rod((x, 0.108, 0), (x - 0.008, 0.138, 0), 0.01, 0.002) for x in np.linspace(-0.045, 0.045, 5)]
    neck = join(
        [
            rod((0.06, 0.085, 0), (0.11, 0.15, 0), 0.02, 0.014),
            ellipsoid((0.032, 0.02, 0.02), (0.125, 0.158, 0), 12),
        ]
    )
    return assemble(
        Part("body", ellipsoid((0.085, 0.04, 0.04), (0, 0.075, 0), 16), skin),
        Part("head", neck, skin),
        Part("tail", rod((-0.07, 0.075, 0), (-0.16, 0.045, 0), 0.024, 0.005), skin),
        Part("legs", join(legs), skin),
        Part("spikes", join(spikes), some_plastic(rng, random_color(rng, (0.7, 0.95), (0.7, 0.95)))),
    )


def ball(rng: Rng) -> Model:
    """A basketball."""
    seams = np.exp(-(np.sin(2 * np.pi * (np.mgrid[:256, :256] / 256.0)) ** 2) / 0.006)
    lines = seams.max(axis=0)
    leather = speckled(rng, (0.8, 0.42, 0.16), (0.6, 0.28, 0.1), 900, 2)
    picture = leather * (1 - lines[..., None]) + 0.06 * lines[..., None]
    ball_shape = ellipsoid((0.12, 0.12, 0.12), (0, 0.12, 0), 28)
    return assemble(Part("ball", ball_shape, make_texture(picture, 0.377, surface="leather")))

"""Small things of the foreign world. Every builder returns an object in its own axes, front towards +z."""

import numpy as np

from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects.materials import fabric, glaze, inlay, lacquer, shine, some_plastic
from egosplat_apartments.objects.model import Model, assemble
from egosplat_apartments.objects.pictures import abstract, clock_face, label, landscape, random_color
from egosplat_apartments.objects.shapes import (
    FORWARD,
    Part,
    Shape,
    box,
    cushion,
    cylinder,
    ellipsoid,
    join,
    lathe,
    rod,
    sheet,
    slab,
)
from egosplat_apartments.objects.textures import Texture, make_texture, speckled


def _spotted(rng: Rng, color: tuple[float, float, float]) -> Texture:
    return make_texture(speckled(rng, color, random_color(rng, (0.2, 0.6), (0.5, 0.95)), 120, 5), 0.1)


def coaster(rng: Rng) -> Model:
    """A square tile in a frame."""
    mat, tile = slab(0.12, 0.12, 0, 0.014), slab(0.1, 0.1, 0.014, 0.018)
    return assemble(Part("mat", mat, shine(rng)), Part("picture", tile, inlay(rng)))


def cup(rng: Rng) -> Model:
    """A cone that widens upwards, with an angular handle."""
    h = rng.uniform(0.09, 0.12)
    body = lathe([(0, 0), (0.026, 0), (0.046, h), (0.042, h), (0.038, h * 0.8), (0, h * 0.8)], 20)
    handle = join([box((0.03, y, -0.008), (0.075, y + 0.012, 0.008)) for y in (h * 0.3, h * 0.8)])
    grip = box((0.068, h * 0.3, -0.008), (0.08, h * 0.8 + 0.012, 0.008))
    glazed = glaze(rng)
    tea = _spotted(rng, (0.5, 0.25, 0.08))
    return assemble(
        Part("body", body, glazed),
        Part("handle", join([handle, grip]), glazed),
        Part("coffee", cylinder(0.037, h * 0.8, h * 0.82), tea),
    )


def bowl(rng: Rng) -> Model:
    """A shallow dish on a high foot, with long fruit."""
    dish = lathe(
        [(0, 0), (0.06, 0), (0.02, 0.04), (0.03, 0.06), (0.13, 0.1), (0.13, 0.108), (0, 0.075)], 28, 50
    )
    fruit = [
        Part(
            f"fruit {k}",
            ellipsoid((0.07, 0.022, 0.024), (0.01 * k, 0.11 + 0.012 * k, 0.035 * (k - 1))),
            _spotted(rng, color),
        )
        for k, color in enumerate(((0.85, 0.75, 0.15), (0.35, 0.6, 0.2), (0.75, 0.2, 0.15)))
    ]
    return assemble(Part("dish", dish, glaze(rng)), *fruit)


def plate(rng: Rng) -> Model:
    """A square plate with three balls."""
    rim = join([slab(0.22, 0.22, 0, 0.012), slab(0.24, 0.24, 0.012, 0.018)])
    balls = [ellipsoid((0.025, 0.025, 0.025), (0.06 * (k - 1), 0.043, 0.02 * (k % 2)), 12) for k in range(3)]
    return assemble(Part("dish", rim, glaze(rng)), Part("cake", join(balls), _spotted(rng, (0.5, 0.3, 0.15))))


def bottle(rng: Rng) -> Model:
    """A round flask with a long neck and a stopper."""
    body = lathe(
        [(0, 0), (0.045, 0), (0.06, 0.04), (0.06, 0.09), (0.018, 0.14), (0.016, 0.24), (0, 0.24)], 24, 50
    )
    jacket = make_texture(
        label(rng, random_color(rng), random_color(rng, (0.1, 0.5), (0.7, 0.95))), 0.19, 0.05
    )
    return assemble(
        Part("body", body, glaze(rng)),
        Part("label", lathe([(0.061, 0.042), (0.061, 0.088)]), jacket),
        Part("cap", ellipsoid((0.02, 0.02, 0.02), (0, 0.255, 0), 12), lacquer(rng)),
    )


def tea_kettle(rng: Rng) -> Model:
    """A tall cone with a straight handle at its side."""
    body = lathe([(0, 0), (0.09, 0), (0.05, 0.18), (0.055, 0.2), (0, 0.2)], 28)
    return assemble(
        Part("body", body, shine(rng)),
        Part("spout", rod((0.05, 0.14, 0), (0.11, 0.19, 0), 0.016, 0.01), shine(rng)),
        Part("handle", rod((-0.06, 0.14, 0), (-0.17, 0.16, 0), 0.012), lacquer(rng)),
        Part("lid", lathe([(0, 0.2), (0.045, 0.2), (0.01, 0.23), (0, 0.26)]), lacquer(rng)),
    )


def pot(rng: Rng) -> Model:
    """A wide pan with one long handle."""
    body = lathe([(0, 0), (0.1, 0), (0.125, 0.07), (0.118, 0.07), (0.1, 0.02), (0, 0.02)], 30)
    lid = lathe([(0, 0.06), (0.115, 0.06), (0.11, 0.075), (0.015, 0.09), (0.02, 0.11), (0, 0.11)], 30)
    return assemble(
        Part("body", body, shine(rng)),
        Part("handle", rod((0.12, 0.055, 0), (0.28, 0.075, 0), 0.012), lacquer(rng)),
        Part("lid", lid, glaze(rng)),
    )


def cutting_board(rng: Rng) -> Model:
    """A round board with a wedge of cheese."""
    wedge = lathe([(0, 0.02), (0.07, 0.02), (0.07, 0.065), (0, 0.065)], 5)
    return assemble(
        Part("board", cylinder(0.16, 0, 0.02, 32), lacquer(rng)),
        Part("bread", wedge, _spotted(rng, (0.9, 0.75, 0.3))),
    )


def box_with_lid(rng: Rng) -> Model:
    """A round hat box with a knob."""
    r, h = rng.uniform(0.09, 0.115), rng.uniform(0.1, 0.15)
    return assemble(
        Part("body", cylinder(r, 0, h, 28), fabric(rng)),
        Part("lid", cylinder(r + 0.006, h - 0.03, h + 0.01, 28), lacquer(rng)),
        Part("ribbon", ellipsoid((0.02, 0.02, 0.02), (0, h + 0.025, 0), 10), shine(rng)),
    )


def tissue_box(rng: Rng) -> Model:
    """A cube with a tissue in a round hole."""
    paper = make_texture(np.full((16, 16, 3), 0.92), 0.1)
    return assemble(
        Part("box", slab(0.13, 0.13, 0, 0.13), fabric(rng)),
        Part("tissue", lathe([(0, 0.13), (0.03, 0.13), (0.045, 0.19), (0.01, 0.16), (0, 0.17)], 9), paper),
    )


def trash_can(rng: Rng) -> Model:
    """A square column with a tilted lid."""
    return assemble(
        Part("pail", slab(0.3, 0.26, 0.02, 0.5), lacquer(rng)),
        Part("lid", rod((-0.15, 0.5, 0), (0.15, 0.5, 0), 0.11), inlay(rng)),
        Part("band", slab(0.32, 0.28, 0, 0.05), shine(rng)),
    )


def clothes_basket(rng: Rng) -> Model:
    """A crate of slats with laundry in it."""
    slats = [
        box((-0.28, y, z - 0.01), (0.28, y + 0.07, z + 0.01))
        for y in (0.02, 0.13, 0.24)
        for z in (-0.19, 0.19)
    ]
    slats += [
        box((x - 0.01, y, -0.19), (x + 0.01, y + 0.07, 0.19))
        for y in (0.02, 0.13, 0.24)
        for x in (-0.28, 0.28)
    ]
    return assemble(
        Part("basket", join([*slats, slab(0.56, 0.38, 0, 0.02)]), lacquer(rng)),
        Part("laundry 0", cushion((-0.26, 0.02, -0.17), (0.26, 0.24, 0.17), 0.06), fabric(rng)),
        Part("laundry 1", ellipsoid((0.14, 0.06, 0.1), (0.06, 0.26, 0.0)), fabric(rng)),
    )


def vase(rng: Rng) -> Model:
    """Stacked blocks with long grass."""
    blocks: list[Shape] = [
        slab(0.1 - 0.012 * k, 0.1 - 0.012 * k, 0.08 * k, 0.08 * k + 0.08) for k in range(3)
    ]
    tips = rng.uniform((-0.1, 0.42, -0.1), (0.1, 0.6, 0.1), (9, 3))
    return assemble(
        Part("body", join(blocks), glaze(rng)),
        Part(
            "stems", join([rod((0, 0.23, 0), tip, 0.003) for tip in tips]), _spotted(rng, (0.6, 0.55, 0.25))
        ),
        Part("blossoms", join([ellipsoid((0.01, 0.04, 0.01), tip, 8) for tip in tips]), fabric(rng)),
    )


def _cactus(rng: Rng, height: float) -> Model:
    """A ribbed column with arms in a box."""
    r = 0.09 * height
    green = _spotted(rng, (0.2, 0.5, 0.28))
    arms = []
    for side, share in ((-1, rng.uniform(0.45, 0.6)), (1, rng.uniform(0.6, 0.75))):
        elbow = (side * 2.6 * r, share * height, 0)
        arms += [
            rod((0, share * height, 0), elbow, 0.7 * r),
            rod(elbow, (side * 2.6 * r, (share + 0.2) * height, 0), 0.7 * r),
        ]
    edge, top = 4.2 * r, 0.25 * height
    return assemble(
        Part("pot", slab(edge, edge, 0, top), glaze(rng)),
        Part("stem", rod((0, top, 0), (0, height, 0), r), green),
        Part("leaves", join(arms), green),
    )


def plant_tall(rng: Rng) -> Model:
    """A cactus that stands on the floor."""
    return _cactus(rng, rng.uniform(0.9, 1.3))


def plant_small(rng: Rng) -> Model:
    """A cactus for a table or shelf."""
    return _cactus(rng, rng.uniform(0.2, 0.28))


def desk_lamp(rng: Rng) -> Model:
    """A glowing ball on three legs."""
    turn = np.radians([0, 120, 240])
    legs = [rod((0.1 * np.sin(a), 0.005, 0.1 * np.cos(a)), (0, 0.2, 0), 0.008) for a in turn]
    ball = ellipsoid((0.085, 0.085, 0.085), (0, 0.28, 0))
    return assemble(
        Part("foot", join(legs), shine(rng)),
        Part("shade", ball, some_plastic(rng, (0.95, 0.9, 0.8)), glow=0.9),
    )


def pillow(rng: Rng) -> Model:
    """A bolster."""
    roll = rod((-0.24, 0.1, 0), (0.24, 0.1, 0), 0.1)
    ends = [ellipsoid((0.02, 0.03, 0.03), (x, 0.1, 0), 8) for x in (-0.29, 0.29)]
    return assemble(Part("pad", roll, fabric(rng)), Part("buttons", join(ends), shine(rng)))


def candle(rng: Rng) -> Model:
    """A squat jar with a flame."""
    flame = make_texture(speckled(rng, (1.0, 0.8, 0.4), (1.0, 0.95, 0.7)), 0.05)
    return assemble(
        Part("holder", cylinder(0.05, 0, 0.06), glaze(rng)),
        Part("wax", cylinder(0.04, 0.06, 0.08), lacquer(rng)),
        Part("flame", ellipsoid((0.008, 0.02, 0.008), (0, 0.1, 0), 8), flame, glow=2.0),
    )


def figurine(rng: Rng) -> Model:
    """A long-legged bird on a cube."""
    plume = glaze(rng)
    legs = [rod((x, 0.06, 0), (x, 0.14, 0), 0.004) for x in (-0.012, 0.012)]
    head = join(
        [rod((0, 0.17, 0.045), (0, 0.24, 0.06), 0.01), ellipsoid((0.018, 0.018, 0.022), (0, 0.25, 0.065))]
    )
    return assemble(
        Part("plinth", slab(0.08, 0.08, 0, 0.06), inlay(rng)),
        Part("body", ellipsoid((0.03, 0.03, 0.055), (0, 0.16, 0)), plume),
        Part("head", head, plume),
        Part("legs", join(legs), shine(rng)),
        Part("tail", rod((0, 0.16, -0.05), (0, 0.19, -0.1), 0.012, 0.004), plume),
    )


def toy(rng: Rng) -> Model:
    """A locomotive."""
    wheels = [
        cylinder(0.025, -0.008, 0.008, 16).moved((x, 0.025, z), FORWARD)
        for x in (-0.07, 0.0, 0.07)
        for z in (-0.045, 0.045)
    ]
    boiler = rod((-0.02, 0.075, 0), (0.1, 0.075, 0), 0.035)
    return assemble(
        Part("body", join([box((-0.1, 0.03, -0.035), (0.1, 0.045, 0.035)), boiler]), lacquer(rng)),
        Part("head", box((-0.1, 0.045, -0.04), (-0.03, 0.13, 0.04)), inlay(rng)),
        Part("legs", join(wheels), shine(rng)),
        Part("spikes", cylinder(0.014, 0.1, 0.14, 12).moved((0.07, 0, 0)), lacquer(rng)),
    )


def desk_clock(rng: Rng) -> Model:
    """A cube with a dial on its front."""
    dial = make_texture(clock_face(rng, random_color(rng, (0.1, 0.5), (0.7, 0.95)), (0.1, 0.1, 0.12)), 0.11)
    face = sheet((-0.055, 0.12, 0.0605), (0.11, 0, 0), (0, -0.11, 0))
    return assemble(
        Part("case", box((-0.065, 0, -0.06), (0.065, 0.13, 0.06)), lacquer(rng)), Part("dial", face, dial)
    )


def speaker(rng: Rng) -> Model:
    """A column with bands."""
    bands = [lathe([(0.071, y), (0.075, y + 0.01), (0.071, y + 0.02)]) for y in (0.04, 0.1, 0.16)]
    return assemble(
        Part("case", cylinder(0.07, 0, 0.22, 28), fabric(rng)), Part("cones", join(bands), shine(rng))
    )


def wall_clock(rng: Rng) -> Model:
    """A square dial in a frame that stands on its tip."""
    r = rng.uniform(0.14, 0.19)
    dial = make_texture(clock_face(rng, random_color(rng, (0.3, 0.7), (0.3, 0.7)), (0.95, 0.93, 0.85)), 2 * r)
    front = sheet((-r, r, 0.031), (2 * r, 0, 0), (0, -2 * r, 0))
    return assemble(
        Part("rim", box((-r - 0.03, -r - 0.03, 0), (r + 0.03, r + 0.03, 0.03)), shine(rng)),
        Part("dial", front, dial),
    )


def picture(rng: Rng) -> Model:
    """A landscape in a round frame."""
    r = rng.uniform(0.22, 0.3)
    scene = make_texture(landscape(rng, (256, 256)), 2 * r)
    frame_shape = lathe([(r * 0.9, 0), (r, 0), (r, 0.03), (r * 0.9, 0.02)], 40).moved(rotation=FORWARD)
    return assemble(
        Part("frame", frame_shape, shine(rng)),
        Part("scene", cylinder(r * 0.92, 0, 0.015, 40).moved(rotation=FORWARD), scene),
    )


def wall_artwork(rng: Rng) -> Model:
    """Three narrow canvases side by side."""
    h = rng.uniform(0.6, 0.85)
    fronts = [sheet((x - 0.13, h / 2, 0.031), (0.26, 0, 0), (0, -h, 0)) for x in (-0.3, 0.0, 0.3)]
    edges = [box((x - 0.13, -h / 2, 0), (x + 0.13, h / 2, 0.03)) for x in (-0.3, 0.0, 0.3)]
    canvas = make_texture(abstract(rng, (448, 160)), 0.26, h)
    return assemble(Part("canvas", join(fronts), canvas), Part("stretcher", join(edges), lacquer(rng)))

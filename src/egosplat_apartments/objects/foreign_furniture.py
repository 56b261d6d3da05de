"""Furniture of the foreign world. Every builder returns an object in its own axes, front towards +z."""

import itertools

import numpy as np

from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects.materials import fabric, inlay, lacquer, shine
from egosplat_apartments.objects.model import Model, Surface, assemble
from egosplat_apartments.objects.shapes import (
    FORWARD,
    Part,
    at_corners,
    box,
    cushion,
    cylinder,
    ellipsoid,
    join,
    lathe,
    rod,
    slab,
)


def _top(use: str, width: float, depth: float, height: float, headroom: float = 2.0) -> Surface:
    return Surface(use, (-width / 2, -depth / 2), (width / 2, depth / 2), height, headroom)


def couch(rng: Rng) -> Model:
    """A slab on runners with three bolsters for a back, and one at one end."""
    w, side = rng.uniform(1.55, 1.95), rng.choice([-1.0, 1.0])
    runners = [rod((x, 0.03, -0.38), (x, 0.03, 0.38), 0.03) for x in (-w / 2 + 0.2, w / 2 - 0.2)]
    rolls = [rod((-w / 2, y, -0.3), (w / 2, y, -0.3), 0.13) for y in (0.55, 0.76)]
    end = rod((side * (w / 2 - 0.12), 0.53, -0.15), (side * (w / 2 - 0.12), 0.53, 0.4), 0.12)
    left, right = (-w / 2 + 0.26, w / 2 - 0.04) if side < 0 else (-w / 2 + 0.04, w / 2 - 0.26)
    return assemble(
        Part("feet", join(runners), shine(rng)),
        Part("base", slab(w, 0.86, 0.06, 0.2), lacquer(rng)),
        Part("seat cushions", cushion((-w / 2, 0.2, -0.43), (w / 2, 0.42, 0.45), 0.08), fabric(rng)),
        Part("back cushions", join(rolls), fabric(rng)),
        Part("arms", end, fabric(rng)),
        surfaces=(Surface("soft", (left, -0.1), (right, 0.32), 0.42),),
    )


def armchair(rng: Rng) -> Model:
    """A drum with a back of spindles around it."""
    turn = np.radians(np.linspace(110, 250, 9))
    posts = [
        rod((0.3 * np.sin(a), 0.36, 0.3 * np.cos(a)), (0.36 * np.sin(a), 0.85, 0.36 * np.cos(a)), 0.016)
        for a in turn
    ]
    ends = [(0.36 * np.sin(a), 0.86, 0.36 * np.cos(a)) for a in turn]
    rail = [rod(a, b, 0.03) for a, b in itertools.pairwise(ends)]
    drum = lathe([(0, 0), (0.26, 0), (0.34, 0.18), (0.34, 0.36), (0, 0.36)], 32)
    seat_cushions = lathe([(0, 0.36), (0.3, 0.36), (0.33, 0.4), (0.28, 0.44), (0, 0.44)], 32)
    return assemble(
        Part("base", drum, fabric(rng)),
        Part("back", join([*posts, *rail]), lacquer(rng)),
        Part("seat cushions", seat_cushions, fabric(rng)),
        surfaces=(Surface("soft", (-0.2, -0.14), (0.2, 0.22), 0.44),),
    )


def dining_chair(rng: Rng) -> Model:
    """A round seat and an oval back on one foot."""
    foot = lathe([(0, 0), (0.21, 0), (0.21, 0.015), (0.03, 0.07), (0.03, 0.42), (0, 0.42)])
    back = join(
        [ellipsoid((0.18, 0.17, 0.018), (0, 0.76, -0.19)), rod((0, 0.44, -0.17), (0, 0.65, -0.19), 0.022)]
    )
    return assemble(
        Part("legs", foot, shine(rng)),
        Part("seat", cylinder(0.21, 0.42, 0.46, 28), lacquer(rng)),
        Part("pad", lathe([(0, 0.46), (0.19, 0.46), (0.19, 0.48), (0, 0.49)], 28), fabric(rng)),
        Part("back", back, lacquer(rng)),
    )


def dining_table(rng: Rng) -> Model:
    """A round top on three slanted legs."""
    r = rng.uniform(0.5, 0.6)
    turn = np.radians([30, 150, 270])
    ways = [(np.sin(a), np.cos(a)) for a in turn]
    legs = [rod((r * 0.85 * x, 0.02, r * 0.85 * z), (0.12 * x, 0.7, 0.12 * z), 0.035) for x, z in ways]
    return assemble(
        Part("top", cylinder(r, 0.69, 0.73, 40), inlay(rng)),
        Part("legs", join(legs), lacquer(rng)),
        surfaces=(_top("table", 1.36 * r, 1.36 * r, 0.73),),
    )


def coffee_table(rng: Rng) -> Model:
    """A block of stone with a step, or a drum with a rim."""
    if rng.random() < 0.5:
        w, d = rng.uniform(0.7, 0.9), rng.uniform(0.42, 0.5)
        parts = (
            Part("body", slab(w * 0.8, d * 0.8, 0, 0.3), lacquer(rng)),
            Part("top", slab(w, d, 0.3, 0.38), inlay(rng)),
        )
        return Model(parts, (_top("table", w - 0.06, d - 0.06, 0.38),))
    r = rng.uniform(0.34, 0.4)
    bands = join(
        [lathe([(r, y), (r + 0.02, y + 0.01), (r + 0.02, y + 0.04), (r, y + 0.05)], 32) for y in (0.05, 0.28)]
    )
    parts = (Part("body", cylinder(r, 0, 0.4, 32), fabric(rng)), Part("rim", bands, shine(rng)))
    return Model(parts, (_top("table", 1.38 * r, 1.38 * r, 0.4),))


def desk(rng: Rng) -> Model:
    """A top on crossed bars with a hanging drawer."""
    drawer = box((-0.5, 0.6, -0.2), (-0.12, 0.7, 0.24))
    crossed = at_corners(lambda x, z: rod((x, 0.01, -z), (x, 0.7, z), 0.02), 0.6 - 0.08, 0.3 - 0.05)
    return assemble(
        Part("top", slab(1.2, 0.6, 0.7, 0.74), lacquer(rng)),
        Part("legs", crossed, shine(rng)),
        Part("drawers", drawer, inlay(rng)),
        Part("knobs", ellipsoid((0.02, 0.02, 0.02), (-0.31, 0.65, 0.26), 10), shine(rng)),
        surfaces=(_top("table", 1.12, 0.52, 0.74),),
    )


def side_table(rng: Rng) -> Model:
    """An hourglass."""
    outline = [(0, 0), (0.2, 0), (0.2, 0.03), (0.07, 0.25), (0.07, 0.3), (0.2, 0.5), (0, 0.5)]
    return assemble(
        Part("body", lathe(outline, 32), lacquer(rng)),
        Part("top", cylinder(0.24, 0.5, 0.53, 32), inlay(rng)),
        surfaces=(_top("table", 0.34, 0.34, 0.53),),
    )


def cabinet(rng: Rng) -> Model:
    """A chest on high legs with two round doors."""
    w, d, h = rng.uniform(1.0, 1.2), 0.4, rng.uniform(0.85, 0.98)
    legs = at_corners(lambda x, z: rod((x, 0, z), (x * 0.9, 0.32, z), 0.022), w / 2 - 0.08, 0.15)
    doors = [cylinder(0.2, 0, 0.02, 32).moved((x, (0.32 + h) / 2, d / 2), FORWARD) for x in (-w / 4, w / 4)]
    knobs = [
        ellipsoid((0.02, 0.02, 0.02), (x, (0.32 + h) / 2, d / 2 + 0.035), 10)
        for x in (-w / 4 + 0.13, w / 4 - 0.13)
    ]
    return assemble(
        Part("body", slab(w, d, 0.3, h), lacquer(rng)),
        Part("doors", join(doors), inlay(rng)),
        Part("knobs", join(knobs), shine(rng)),
        Part("legs", legs, shine(rng)),
        surfaces=(_top("table", w - 0.04, d - 0.04, h),),
    )


def tv_stand(rng: Rng) -> Model:
    """A plank on two drums."""
    w = rng.uniform(1.5, 1.8)
    drums = [cylinder(0.17, 0, 0.36, 28).moved((x, 0, 0)) for x in (-w / 2 + 0.3, w / 2 - 0.3)]
    return assemble(
        Part("top", slab(w, 0.4, 0.36, 0.42), lacquer(rng)),
        Part("legs", join(drums), inlay(rng)),
        surfaces=(
            Surface("television", (-0.65, -0.17), (0.65, 0.15), 0.42),
            Surface("table", (-w / 2, 0.06), (w / 2, 0.2), 0.42),
        ),
    )


def bookcase(rng: Rng) -> Model:
    """Boards on four posts, each shorter than the one below."""
    rows = int(rng.integers(4, 6))
    widths = np.linspace(1.05, 0.7, rows)
    boards = [slab(width, 0.3, 0.1 + 0.37 * row, 0.13 + 0.37 * row) for row, width in enumerate(widths)]
    top = 0.13 + 0.37 * (rows - 1)
    posts = [rod((x, 0, z), (x * 0.62, top, z), 0.016) for x in (-0.5, 0.5) for z in (-0.12, 0.12)]
    shelves = [_top("shelf", 0.76 * width, 0.26, 0.13 + 0.37 * row, 0.33) for row, width in enumerate(widths)]
    return assemble(
        Part("shelves", join(boards), inlay(rng)),
        Part("sides", join(posts), shine(rng)),
        surfaces=tuple(shelves),
    )


def refrigerator(rng: Rng) -> Model:
    """One rounded door with a bar across it, on feet."""
    body = lacquer(rng)
    feet = join([cylinder(0.03, 0, 0.1, 12).moved((x, 0, z)) for x in (-0.28, 0.28) for z in (-0.22, 0.2)])
    return assemble(
        Part("body", cushion((-0.36, 0.08, -0.31), (0.36, 1.5, 0.26), 0.1), body),
        Part("doors", cushion((-0.35, 0.1, 0.22), (0.35, 1.48, 0.34), 0.055), body),
        Part("handles", rod((-0.25, 1.0, 0.37), (0.1, 1.0, 0.37), 0.02), shine(rng)),
        Part("band", box((-0.34, 1.2, 0.335), (0.34, 1.26, 0.345)), inlay(rng)),
        Part("feet", feet, shine(rng)),
    )


def bed_frame(rng: Rng) -> Model:
    """A low platform with a round head board."""
    head = cylinder(0.5, -0.03, 0.03, 40).moved((0, 0.5, -1.0), FORWARD)
    return assemble(
        Part("base", slab(0.8, 1.8, 0.0, 0.12), inlay(rng)),
        Part("rails", slab(1.05, 2.0, 0.12, 0.24), lacquer(rng)),
        Part("head board", head.stretched((1.0, 0.9, 1.0)), fabric(rng)),
        surfaces=(Surface("bed", (-0.5, -0.96), (0.5, 0.98), 0.24),),
    )


def step_stool(rng: Rng) -> Model:
    """A ladder of two rails with three rungs, leaning on two struts."""
    rails = [rod((x, 0.01, 0.22), (x * 0.8, 0.62, 0.0), 0.016) for x in (-0.2, 0.2)]
    struts = [rod((x, 0.01, -0.2), (x * 0.8, 0.62, 0.0), 0.012) for x in (-0.2, 0.2)]
    steps = [
        box((-0.18, y, z - 0.05), (0.18, y + 0.025, z + 0.05))
        for y, z in ((0.18, 0.16), (0.38, 0.09), (0.6, 0.0))
    ]
    return assemble(
        Part("sides", join([*rails, *struts]), shine(rng)), Part("treads", join(steps), inlay(rng))
    )


def shelf(rng: Rng) -> Model:
    """An open box on the wall."""
    w, h = rng.uniform(0.55, 0.75), 0.3
    sides = [box((x - 0.01, 0, 0), (x + 0.01, h, 0.22)) for x in (-w / 2 + 0.01, w / 2 - 0.01)]
    boards = [box((-w / 2, y, 0), (w / 2, y + 0.02, 0.22)) for y in (0.0, h)]
    return assemble(
        Part("board", join(boards), lacquer(rng)),
        Part("sides", join(sides), inlay(rng)),
        surfaces=tuple(
            Surface("shelf", (-w / 2 + 0.03, 0.02), (w / 2 - 0.03, 0.2), y + 0.02, room)
            for y, room in ((0.0, 0.26), (h, 0.5))
        ),
    )

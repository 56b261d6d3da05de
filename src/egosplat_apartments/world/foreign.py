"""The building of the foreign world: long and wide rooms with pillars, niches and radiators, and other surfaces."""

from dataclasses import replace

import numpy as np

from egosplat_apartments.arrays import Array, Rng
from egosplat_apartments.objects.materials import (
    basket_parquet,
    bricks,
    dots,
    fabric,
    inlay,
    lacquer,
    mosaic,
    shine,
    some_plastic,
    terrazzo,
)
from egosplat_apartments.objects.model import boxes_touch
from egosplat_apartments.objects.pictures import random_color
from egosplat_apartments.objects.shapes import Part, box, cylinder, ellipsoid, join, rod
from egosplat_apartments.objects.textures import Picture, make_texture, noise, shaded
from egosplat_apartments.world.room import Light, Opening, Room, opening_box
from egosplat_apartments.world.shell import ceiling_shape, floor_shape, trim, wall_part

# Cold, neutral and orange light.
_LAMPS = ((5.2, 6.4, 8.6), (8.0, 8.0, 7.6), (10.5, 6.6, 3.4))
_PENDANT_M = 0.75


def foreign_room(rng: Rng) -> Room:
    """A hall or a square room, higher than usual, with a low wide window and a tall narrow one."""
    hall = rng.random() < 0.5
    width, depth = (rng.uniform(*a) for a in (((6.6, 7.4), (3.6, 4.0)) if hall else ((5.3, 5.9), (5.0, 5.5))))
    room = Room(width, depth, rng.uniform(2.8, 3.3), (), light=_light(rng, width, depth))
    walls = rng.permutation(4).tolist()
    left = rng.uniform(0.25, room.length(walls[0]) - 1.4)
    openings = [Opening(walls[0], left, left + 1.1, 0.0, 2.2, True)]
    shapes = ((1.9, 2.4, 0.35, 0.5, 2.3), (0.55, 0.75, 0.9, 1.1, 2.6))
    for wall, (least, most, low, high, top) in zip(walls[1:3], shapes, strict=True):
        span = rng.uniform(least, most)
        left = rng.uniform(0.5, room.length(wall) - span - 0.5)
        openings.append(Opening(wall, left, left + span, rng.uniform(low, high), top, False))
    return _with_blocks(replace(room, openings=tuple(openings)), rng)


def _light(rng: Rng, width: float, depth: float) -> Light:
    """A pendant away from the middle, and a low sun."""
    x, z = rng.uniform(-0.22, 0.22, 2) * (width, depth)
    sun = np.array(_LAMPS[rng.integers(3)]) * rng.uniform(0.5, 1.0)
    return Light((x, z), _PENDANT_M, _LAMPS[rng.integers(3)], tuple(sun.tolist()), (0.3, 0.55))


def _with_blocks(room: Room, rng: Rng) -> Room:
    """Add a niche's corner, a pillar, and a radiator, each where it hides no opening."""
    half, blocks = np.array([room.width / 2, room.depth / 2]), list[Array]()
    corner, reach = rng.choice([-1.0, 1.0], 2), rng.uniform(0.7, 1.1, 2)
    pillar = rng.uniform(-0.3, 0.3, 2) * half * 2
    wall = int(rng.integers(4))
    along = rng.uniform(0.3, room.length(wall) - 1.3)
    ends = np.stack([room.at(wall, along, 0.0), room.at(wall, along + 1.0, 0.6, 0.1)])
    proposals = [
        _upright(corner * half, corner * (half - reach), room.height),
        _upright(pillar - 0.17, pillar + 0.17, room.height),
        np.stack([ends.min(axis=0), ends.max(axis=0)]),
    ]
    keep = [opening_box(room, opening) + [[-0.15, -1, -0.15], [0.15, 1, 0.15]] for opening in room.openings]
    for block in proposals:
        if not any(boxes_touch(block, other, 0.02) for other in (*keep, *blocks)):
            blocks.append(block)
    return replace(room, blocks=tuple(blocks))


def _upright(first: Array, second: Array, height: float) -> Array:
    low, high = np.minimum(first, second), np.maximum(first, second)
    return np.array([[low[0], 0.0, low[1]], [high[0], height, high[1]]])


def foreign_shell(room: Room, rng: Rng) -> list[Part]:
    """The parts of the instance ``ApartmentEnv``, in world axes, and what stands in the way but has no name."""
    return [part for piece in (_ground, _ceiling, _walls, _blocks, trim) for part in piece(room, rng)]


def _ground(room: Room, rng: Rng) -> list[Part]:
    """A floor of parquet, terrazzo or bricks, and a round rug."""
    w, d, shape = room.width, room.depth, (1024, 1024)
    dull = random_color(rng, (0.1, 0.5), (0.4, 0.7))
    floors: tuple[Picture, ...] = (
        basket_parquet(rng, (0.5, 0.33, 0.2), shape),
        terrazzo(rng, dull, shape, 5000),
        bricks(rng, (0.58, 0.32, 0.24), (0.5, 0.48, 0.45), shape, 26),
    )
    r, (x, z) = rng.uniform(0.8, 1.05), rng.uniform(-0.12, 0.12, 2) * (w, d)
    colors = [random_color(rng, (0.3, 0.8), (0.3, 0.9)) for _ in range(4)]
    rug = make_texture(mosaic(rng, colors, (512, 512), 160), 2 * r)
    ground = make_texture(floors[rng.integers(3)], w, d)
    return [
        Part("floor", floor_shape(room), ground),
        Part("rug", cylinder(r, 0.0, 0.007, 48).moved((x, 0, z)), rug),
    ]


def _ceiling(room: Room, rng: Rng) -> list[Part]:
    """Concrete between beams, and a pendant."""
    w, d, h = room.width, room.depth, room.height
    tone = random_color(rng, (0.0, 0.15), (0.6, 0.85))
    stains = 1 + 0.12 * noise(rng, (512, 512), 1.2) + 0.06 * noise(rng, (512, 512), 0.4)
    concrete = np.asarray(tone) * stains[..., None]
    beams = [
        box((x - 0.07, h - 0.16, -d / 2), (x + 0.07, h, d / 2)) for x in np.linspace(-w / 2, w / 2, 6)[1:-1]
    ]
    x, z = room.light.place
    low = h - room.light.drop
    return [
        Part("ceiling", ceiling_shape(room), make_texture(concrete, w, d)),
        Part("beams", join(beams), lacquer(rng)),
        Part(
            "lamp", ellipsoid((0.11, 0.11, 0.11), (x, low, z)), some_plastic(rng, (0.98, 0.95, 0.9)), glow=2.2
        ),
        Part("lamp base", rod((x, low + 0.1, z), (x, h, z), 0.008), shine(rng)),
    ]


def _walls(room: Room, rng: Rng) -> list[Part]:
    """Two walls of bricks or mosaic, the others painted with dots that fade."""
    parts = []
    strong = rng.permutation(4)[:2].tolist()
    for wall in range(4):
        shape, ground = (512, 1024), random_color(rng, (0.1, 0.45), (0.6, 0.95))
        if wall in strong and rng.random() < 0.5:
            picture = bricks(rng, ground, (0.75, 0.73, 0.7), shape, 34)
        elif wall in strong:
            tints = [tuple(np.clip(np.asarray(ground) * shade, 0, 1)) for shade in (0.8, 0.95, 1.1)]
            picture = mosaic(rng, tints, shape, 420)
        else:
            faint = tuple(0.8 * np.asarray(ground) + 0.2 * np.asarray(random_color(rng)))
            picture = shaded(np.tile(dots(rng, ground, faint, 6), (2, 4, 1)), 0.06 * noise(rng, shape, 1.1))
        parts.append(wall_part(room, wall, picture))
    return parts


def _blocks(room: Room, rng: Rng) -> list[Part]:
    """The blocks: high ones are brickwork or inlaid, a low one is a radiator with ribs."""
    parts = []
    for number, (low, high) in enumerate(room.blocks):
        if high[1] > 1.0:
            parts.append(
                Part(f"pillar {number}", box(low, high), (inlay if rng.random() < 0.5 else fabric)(rng))
            )
            continue
        axis = 0 if high[0] - low[0] > high[2] - low[2] else 2
        ribs = []
        for place in np.arange(low[axis] + 0.04, high[axis] - 0.03, 0.09):
            ends = (low.copy(), high.copy())
            ends[0][axis], ends[1][axis], ends[0][1] = place - 0.03, place + 0.03, 0.1
            ribs.append(box(*ends))
        parts.append(Part(f"radiator {number}", join(ribs), lacquer(rng)))
    return parts

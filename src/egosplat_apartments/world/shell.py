"""The surfaces of the room: floor, walls with their openings, ceiling, and the corridor behind the door."""

import itertools

import numpy as np

from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects.materials import some_fabric, some_paint, some_plastic, some_wood
from egosplat_apartments.objects.pictures import random_color
from egosplat_apartments.objects.shapes import Part, Shape, cylinder, join, sheet
from egosplat_apartments.objects.textures import (
    Color,
    Picture,
    make_texture,
    motifs,
    noise,
    planks,
    shaded,
    speckled,
)
from egosplat_apartments.world.room import (
    REVEAL_M,
    UP,
    Room,
    block,
    corridor_bounds,
    reveal,
    window_parts,
)

# Height of the corridor.
_HEIGHT_M = 2.3


def corridor_parts(room: Room, rng: Rng) -> list[Part]:
    """A short corridor across the doorway, where people wait out of sight, and the open door."""
    door, (left, right, near, far) = room.door, corridor_bounds(room)
    across, inward = room.right(door.wall), room.normal(door.wall)
    ground = sheet(room.at(door.wall, left, 0, -far), across * (right - left), inward * far)
    ceiling = sheet(
        room.at(door.wall, left, _HEIGHT_M, -near), across * (right - left), -inward * (far - near)
    )
    colors = [random_color(rng) for _ in range(2)]
    paper = motifs(rng, random_color(rng, (0.1, 0.3), (0.7, 0.9)), colors, 150, (8, 26), (512, 512))
    stone = speckled(rng, (0.62, 0.6, 0.56), (0.35, 0.33, 0.32), 900, 5)
    plaster = make_texture(
        shaded((0.88, 0.87, 0.85), 0.04 * noise(rng, (256, 256), 1.0)), 1.0, surface="plaster"
    )
    corner = room.at(door.wall, door.left + 0.1, 0.005, -REVEAL_M - 0.6)
    middle = (door.left + 0.25, door.right - 0.25)
    lamp = block(room, door.wall, middle, (_HEIGHT_M - 0.03, _HEIGHT_M - 0.005), (-near - 0.8, -near - 0.5))
    return [
        Part("corridor walls", _corridor_walls(room), make_texture(paper, 2.0, surface="flowered paper")),
        Part("corridor floor", ground, make_texture(stone, 0.8, surface="speckled stone")),
        Part("corridor ceiling", ceiling, plaster),
        Part("corridor lamp", lamp, some_plastic(rng, (0.98, 0.95, 0.85)), glow=1.6),
        Part("door mat", sheet(corner, across * 0.7, inward * 0.45), some_fabric(rng)),
        *_door(room, rng),
    ]


def _corridor_walls(room: Room) -> Shape:
    door, (left, right, near, far) = room.door, corridor_bounds(room)
    across, inward, down = room.right(door.wall), room.normal(door.wall), np.array([0.0, -1.0, 0.0])
    depth, top = far - near, _HEIGHT_M
    beside = (door.left - left, right - door.right, door.right - door.left)
    return join(
        [
            sheet(room.at(door.wall, left, top, -far), across * (right - left), down * top),
            sheet(room.at(door.wall, left, top, -near), -inward * depth, down * top),
            sheet(room.at(door.wall, right, top, -far), inward * depth, down * top),
            sheet(room.at(door.wall, door.left, top, -near), -across * beside[0], down * top),
            sheet(room.at(door.wall, right, top, -near), -across * beside[1], down * top),
            sheet(room.at(door.wall, door.right, top, -near), -across * beside[2], down * (top - door.top)),
        ]
    )


def _door(room: Room, rng: Rng) -> list[Part]:
    """Reveal, frame and door leaf, which is open into the corridor."""
    door, near = room.door, REVEAL_M
    posts = ((door.left - 0.06, door.left), (door.right, door.right + 0.06))
    frame = [block(room, door.wall, post, (0.0, door.top + 0.06), (0.0, 0.02)) for post in posts]
    frame.append(block(room, door.wall, (door.left, door.right), (door.top, door.top + 0.06), (0.0, 0.02)))
    beside = (door.right + 0.02, door.right + 0.06)
    leaf = block(room, door.wall, beside, (0.01, door.top - 0.01), (-near - 0.88, -near - 0.02))
    return [
        Part("door reveal", reveal(room, door), some_paint(rng)),
        Part("door frame", join(frame), some_wood(rng)),
        Part("door", leaf, some_paint(rng)),
    ]


def build_shell(room: Room, rng: Rng) -> list[Part]:
    """The parts of the instance ``ApartmentEnv``, in world axes."""
    ground = [_floor(room, rng), _rug(room, rng)]
    return [*ground, _ceiling(room, rng), *_lamp(room, rng), *_walls(room, rng), *trim(room, rng)]


def floor_shape(room: Room) -> Shape:
    """The whole floor, seen from above."""
    w, d = room.width, room.depth
    return sheet((-w / 2, 0, -d / 2), (w, 0, 0), (0, 0, d), 0.12)


def ceiling_shape(room: Room) -> Shape:
    """The whole ceiling, seen from below."""
    w, d = room.width, room.depth
    return sheet((-w / 2, room.height, d / 2), (w, 0, 0), (0, 0, -d))


def _floor(room: Room, rng: Rng) -> Part:
    boards = planks(
        rng,
        [(0.55, 0.36, 0.2), (0.42, 0.27, 0.16), (0.68, 0.5, 0.32), (0.5, 0.42, 0.36)][rng.integers(4)],
        (1024, 1024),
        26,
    )
    return Part("floor", floor_shape(room), make_texture(boards, room.width, room.depth, surface="wood"))


def _rug(room: Room, rng: Rng) -> Part:
    w, d = rng.uniform(1.8, 2.4), rng.uniform(1.4, 1.8)
    x, z = rng.uniform(-0.15, 0.15) * room.width, rng.uniform(-0.15, 0.15) * room.depth
    ground = random_color(rng, (0.3, 0.7), (0.3, 0.7))
    colors = [random_color(rng, (0.2, 0.8), (0.3, 0.95)) for _ in range(4)]
    picture = motifs(rng, ground, colors, 220, (7, 30), (512, 704))
    for inset, tint in ((0, colors[0]), (12, (0.9, 0.87, 0.78)), (20, ground)):
        for rows in (picture, np.swapaxes(picture, 0, 1)):
            rows[inset : inset + 10] = tint
            rows[len(rows) - inset - 10 : len(rows) - inset] = tint
    picture *= 1 + 0.12 * noise(rng, picture.shape[:2], 0.5)[..., None]
    shape = sheet((x - w / 2, 0.006, z - d / 2), (w, 0, 0), (0, 0, d))
    return Part("rug", shape, make_texture(picture, w, d, surface="flowered cloth"))


def _ceiling(room: Room, rng: Rng) -> Part:
    """Plaster with a faint painted pattern."""
    # COLMAP needs features on the ceiling that can be matched between views.
    white = (0.9, 0.88, 0.84)
    tints = [(0.84, 0.81, 0.76), (0.86, 0.83, 0.8), (0.78, 0.76, 0.73)]
    picture = shaded(motifs(rng, white, tints, 700, (4, 14), (768, 768)), 0.03 * noise(rng, (768, 768), 0.8))
    return Part(
        "ceiling", ceiling_shape(room), make_texture(picture, room.width, room.depth, surface="plaster")
    )


def _lamp(room: Room, rng: Rng) -> list[Part]:
    white = some_plastic(rng, (0.98, 0.94, 0.82))
    disc = cylinder(0.2, room.height - 0.09, room.height - 0.04, 28)
    return [
        Part("lamp", disc, white, glow=2.2),
        Part("lamp base", cylinder(0.1, room.height - 0.04, room.height), some_paint(rng)),
    ]


def _walls(room: Room, rng: Rng) -> list[Part]:
    """Four walls in two wallpapers whose patterns repeat nowhere on a wall."""
    grounds = [random_color(rng, (0.06, 0.3), (0.78, 0.95)) for _ in range(2)]
    inks = [
        [_faint(random_color(rng, (0.2, 0.6), (0.3, 0.85)), ground) for _ in range(3)] for ground in grounds
    ]
    sizes = [(3, int(rng.integers(7, 17))) for _ in range(2)]
    parts = []
    for wall in range(4):
        paper = int(rng.random() < 0.5)
        # A new picture for each wall: repeated patterns would give wrong matches.
        shape, count = (512, 1024), 11_000 // sizes[paper][1]
        picture = motifs(rng, grounds[paper], inks[paper], count, sizes[paper], shape)
        picture = shaded(picture, 0.05 * noise(rng, shape, 0.7))
        parts.append(wall_part(room, wall, picture, "flowered paper"))
    return parts


def _faint(ink: Color, ground: Color) -> Color:
    """Mix 45 % of the ground color into the ink."""
    # Strong wallpaper would dominate the objects in front of it.
    red, green, blue = (0.55 * a + 0.45 * b for a, b in zip(ink, ground, strict=True))
    return red, green, blue


def wall_part(room: Room, wall: int, picture: Picture, surface: str = "") -> Part:
    """A wall with holes for its openings; the picture is continuous across the pieces."""
    holes = [opening for opening in room.openings if opening.wall == wall]
    cuts = sorted({0.0, room.length(wall), *(cut for hole in holes for cut in (hole.left, hole.right))})
    pieces = []
    for left, right in itertools.pairwise(cuts):
        inside = [hole for hole in holes if hole.left <= left and right <= hole.right]
        spans = [(hole.bottom, hole.top) for hole in inside] or [(room.height, room.height)]
        for low, high in ((0.0, spans[0][0]), (spans[0][1], room.height)):
            if high - low > 1e-9:
                pieces.append(_piece(room, wall, (left, right), (low, high)))
    texture = make_texture(picture, room.length(wall), room.height, surface=surface)
    return Part(f"wall {wall}", join(pieces), texture)


def _piece(room: Room, wall: int, along: tuple[float, float], heights: tuple[float, float]) -> Shape:
    corner = room.at(wall, along[0], heights[1])
    flat = sheet(corner, room.right(wall) * (along[1] - along[0]), -UP * (heights[1] - heights[0]), 0.14)
    return Shape(flat.vertices, flat.normals, flat.uv + (along[0], room.height - heights[1]), flat.faces)


def trim(room: Room, rng: Rng) -> list[Part]:
    """What the shells of all worlds share: skirting, windows, and the corridor behind the door."""
    pieces = []
    for wall in range(4):
        gap = (room.door.left - 0.06, room.door.right + 0.06) if room.door.wall == wall else (0.0, 0.0)
        spans = [(0.0, gap[0]), (gap[1], room.length(wall))] if gap[1] else [(0.0, room.length(wall))]
        pieces += [
            block(room, wall, span, (0.0, 0.08), (0.0, 0.012)) for span in spans if span[1] - span[0] > 0.01
        ]
    parts = [Part("skirting", join(pieces), some_wood(rng))]
    for opening in room.windows:
        parts += window_parts(room, opening, rng)
    return parts + corridor_parts(room, rng)

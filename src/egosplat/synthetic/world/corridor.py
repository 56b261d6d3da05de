"""The corridor behind the door."""

import numpy as np

from egosplat.synthetic.objects.materials import some_fabric, some_paint, some_plastic, some_wood
from egosplat.synthetic.objects.pictures import random_colour
from egosplat.synthetic.objects.shapes import Part, Shape, join, sheet
from egosplat.synthetic.objects.textures import Rng, make_texture, motifs, noise, shaded, speckled
from egosplat.synthetic.world.openings import block, reveal
from egosplat.synthetic.world.room import REVEAL_M, Room, corridor_bounds

_HEIGHT_M = 2.3


def corridor_parts(room: Room, rng: Rng) -> list[Part]:
    """A short corridor across the doorway, where people wait out of sight, and the open door."""
    door, (left, right, near, far) = room.door, corridor_bounds(room)
    across, inward = room.right(door.wall), room.normal(door.wall)
    ground = sheet(room.at(door.wall, left, 0, -far), across * (right - left), inward * far)
    ceiling = sheet(
        room.at(door.wall, left, _HEIGHT_M, -near), across * (right - left), -inward * (far - near)
    )
    colours = [random_colour(rng) for _ in range(2)]
    paper = motifs(rng, random_colour(rng, (0.1, 0.3), (0.7, 0.9)), colours, (512, 512), 150, (8, 26))
    stone = speckled(rng, (0.62, 0.6, 0.56), (0.35, 0.33, 0.32), 900, 5)
    plaster = make_texture(
        shaded((0.88, 0.87, 0.85), 0.04 * noise(rng, (256, 256), 1.0)), 1.0, surface="plaster"
    )
    middle = (door.left + 0.25, door.right - 0.25)
    lamp = block(room, door.wall, middle, (_HEIGHT_M - 0.03, _HEIGHT_M - 0.005), (-near - 0.8, -near - 0.5))
    return [
        Part("corridor walls", _walls(room), make_texture(paper, 2.0, surface="flowered paper")),
        Part("corridor floor", ground, make_texture(stone, 0.8, surface="speckled stone")),
        Part("corridor ceiling", ceiling, plaster),
        Part("corridor lamp", lamp, some_plastic(rng, (0.98, 0.95, 0.85)), glow=1.6),
        Part("door mat", _mat(room), some_fabric(rng)),
        *_door(room, rng),
    ]


def _walls(room: Room) -> Shape:
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


def _mat(room: Room) -> Shape:
    door = room.door
    corner = room.at(door.wall, door.left + 0.1, 0.005, -REVEAL_M - 0.6)
    return sheet(corner, room.right(door.wall) * 0.7, room.normal(door.wall) * 0.45)

"""Windows with the view behind them, and the wall thickness in every opening."""

import numpy as np

from egosplat_apartments.objects.materials import some_paint, some_plastic, some_wood
from egosplat_apartments.objects.pictures import outside
from egosplat_apartments.objects.shapes import Part, Shape, box, join, sheet
from egosplat_apartments.objects.textures import Rng, make_texture
from egosplat_apartments.world.room import REVEAL_M, Opening, Room

_UP = np.array([0.0, 1.0, 0.0])


def block(
    room: Room, wall: int, along: tuple[float, float], heights: tuple[float, float], away: tuple[float, float]
) -> Shape:
    """A box placed along a wall."""
    ends = np.stack([room.at(wall, a, h, d) for a, h, d in zip(along, heights, away, strict=True)])
    return box(ends.min(axis=0), ends.max(axis=0))


def window_parts(room: Room, hole: Opening, rng: Rng) -> list[Part]:
    """Reveal, frame with a cross bar, sill, and the view behind."""
    wall, middle = hole.wall, (hole.left + hole.right) / 2
    bars = [(hole.left, hole.left + 0.05), (middle - 0.02, middle + 0.02), (hole.right - 0.05, hole.right)]
    frame = [block(room, wall, bar, (hole.bottom, hole.top), (-0.1, -0.06)) for bar in bars]
    for low, high in ((hole.bottom, hole.bottom + 0.05), (hole.top - 0.05, hole.top)):
        frame.append(block(room, wall, (hole.left, hole.right), (low, high), (-0.1, -0.06)))
    sill = block(
        room,
        wall,
        (hole.left - 0.06, hole.right + 0.06),
        (hole.bottom - 0.03, hole.bottom),
        (-REVEAL_M, 0.03),
    )
    return [
        Part("window reveal", reveal(room, hole), some_paint(rng)),
        Part("window frame", join(frame), some_plastic(rng, (0.93, 0.93, 0.92))),
        Part("window sill", sill, some_wood(rng)),
        _view(room, hole, rng),
    ]


def _view(room: Room, hole: Opening, rng: Rng) -> Part:
    """An image of the street behind a window, curved so that no ray passes around it."""
    wall, depth = hole.wall, 0.7
    left, right = max(0.0, hole.left - 0.9), min(room.length(wall), hole.right + 0.9)
    bottom, top = hole.bottom - 0.8, hole.top + 0.9
    along, inward = room.right(wall) * (right - left), room.normal(wall) * depth
    up = _UP * (top - bottom)
    back = sheet(room.at(wall, left, top, -depth), along, -up, 0.5)
    sides = [
        sheet(room.at(wall, left, top), -inward, -up, 0.5),
        sheet(room.at(wall, right, top, -depth), inward, -up, 0.5),
        sheet(room.at(wall, left, top), along, -inward, 0.5),
        sheet(room.at(wall, left, bottom, -depth), along, inward, 0.5),
    ]
    return Part(
        "view", join([back, *sides]), make_texture(outside(rng), right - left, top - bottom), glow=1.6
    )


def reveal(room: Room, hole: Opening) -> Shape:
    """The wall thickness around an opening: sides, top and, for a window, bottom."""
    wall, depth = hole.wall, REVEAL_M
    right, inward = room.right(wall), room.normal(wall)
    rise = hole.top - hole.bottom
    sides = [
        sheet(room.at(wall, hole.left, hole.top), -inward * depth, -_UP * rise),
        sheet(room.at(wall, hole.right, hole.top, -depth), inward * depth, -_UP * rise),
        sheet(room.at(wall, hole.left, hole.top), right * (hole.right - hole.left), -inward * depth),
    ]
    if not hole.door:
        sides.append(
            sheet(
                room.at(wall, hole.left, hole.bottom, -depth),
                right * (hole.right - hole.left),
                inward * depth,
            )
        )
    return join(sides)

"""The room: its size, its walls, and the openings in them with windows and the view behind."""

from dataclasses import dataclass

import numpy as np

from egosplat_apartments.arrays import Array, Rng
from egosplat_apartments.objects.materials import some_paint, some_plastic, some_wood
from egosplat_apartments.objects.pictures import outside
from egosplat_apartments.objects.shapes import Part, Shape, box, join, sheet
from egosplat_apartments.objects.textures import make_texture

Range = tuple[float, float]

CORRIDOR_DEPTH_M, CORRIDOR_WIDTH_M = 1.3, 3.0

# Thickness of the walls, visible in doors and windows.
REVEAL_M = 0.12

# Free depth before the door, so that people can walk in.
_DOOR_CLEAR_M = 1.0
UP = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class Opening:
    """A hole in a wall.

    Attributes:
        wall: its number, 0 to 3.
        left, right: distance along the wall from its left end as seen from inside [m].
        bottom, top: heights [m]. door: True for the door to the corridor, False for a window.
    """

    wall: int
    left: float
    right: float
    bottom: float
    top: float
    door: bool


@dataclass(frozen=True)
class Light:
    """Lamp and sun of a room.

    Attributes:
        place: (x, z) of the lamp from the middle of the room; drop: distance below the ceiling [m].
        lamp, sun: power in red, green and blue.
        sun_rise: least and largest rise of the sun for each meter towards it [m].
    """

    place: tuple[float, float] = (0.0, 0.0)
    drop: float = 0.2
    # Warm light: more red than blue.
    lamp: tuple[float, float, float] = (7.5, 6.8, 5.8)
    sun: tuple[float, float, float] = (5.5, 4.9, 4.0)
    sun_rise: tuple[float, float] = (0.7, 1.1)


@dataclass(frozen=True)
class Room:
    """The room's size and openings, what is built into it, and its light.

    World axes: y up, the floor at y = 0, the room's center above the origin. The inward normals of walls 0..3
    are +z, +x, -z, -x. ``blocks`` are (2, 3) boxes in the room that belong to the building.
    """

    width: float
    depth: float
    height: float
    openings: tuple[Opening, ...]
    blocks: tuple[Array, ...] = ()
    light: Light = Light()

    def normal(self, wall: int) -> Array:
        """(3,) inward unit normal of a wall."""
        return np.array([(0, 0, 1), (1, 0, 0), (0, 0, -1), (-1, 0, 0)], dtype=np.float64)[wall]

    def right(self, wall: int) -> Array:
        """(3,) unit vector to the right along a wall, as seen from inside."""
        return np.cross(UP, self.normal(wall))

    def length(self, wall: int) -> float:
        """Length of a wall [m]."""
        return self.width if wall % 2 == 0 else self.depth

    def corner(self, wall: int) -> Array:
        """(3,) lower left corner of a wall, as seen from inside."""
        reach = self.depth if wall % 2 == 0 else self.width
        return -self.normal(wall) * reach / 2 - self.right(wall) * self.length(wall) / 2

    def at(self, wall: int, along: float, height: float, away: float = 0.0) -> Array:
        """(3,) point at a distance along a wall, a height, and a distance from the wall into the room [m]."""
        return self.corner(wall) + self.right(wall) * along + UP * height + self.normal(wall) * away

    @property
    def door(self) -> Opening:
        """The opening that is the door."""
        return next(opening for opening in self.openings if opening.door)

    @property
    def windows(self) -> tuple[Opening, ...]:
        """All openings except the door."""
        return tuple(opening for opening in self.openings if not opening.door)


def random_room(rng: Rng, widths: Range = (5.0, 5.8), depths: Range = (4.1, 4.8)) -> Room:
    """A room with a door and two windows in three different walls."""
    width, depth, height = rng.uniform(*widths), rng.uniform(*depths), rng.uniform(2.5, 2.7)
    room = Room(width, depth, height, ())
    walls = rng.permutation(4)
    door_left = rng.uniform(0.25, room.length(int(walls[0])) - 1.2)
    openings = [Opening(int(walls[0]), door_left, door_left + 0.9, 0.0, 2.05, True)]
    for wall in walls[1:3].tolist():
        span = rng.uniform(1.1, 1.7)
        left = rng.uniform(0.6, room.length(wall) - span - 0.6)
        openings.append(
            Opening(wall, left, left + span, rng.uniform(0.85, 1.0), rng.uniform(2.1, 2.25), False)
        )
    return Room(width, depth, height, tuple(openings))


def busy_room(rng: Rng) -> Room:
    """A room in which two people have space to work."""
    return random_room(rng, (6.2, 7.0), (5.2, 5.8))


def corridor_bounds(room: Room) -> tuple[float, float, float, float]:
    """Left and right end along the door's wall, near and far distance behind it [m]."""
    middle = (room.door.left + room.door.right) / 2
    half = CORRIDOR_WIDTH_M / 2
    return middle - half, middle + half, REVEAL_M, REVEAL_M + CORRIDOR_DEPTH_M


def hidden_place(room: Room) -> Array:
    """(2,) x and z of a place in the corridor that is out of sight from the room."""
    left, _, near, far = corridor_bounds(room)
    return room.at(room.door.wall, left + 0.35, 0.0, -(near + far) / 2)[[0, 2]]


def opening_box(room: Room, opening: Opening) -> Array:
    """(2, 3) box in front of an opening that must stay free."""
    away = _DOOR_CLEAR_M if opening.door else 0.25
    first = room.at(opening.wall, opening.left, opening.bottom)
    last = room.at(opening.wall, opening.right, opening.top, away)
    return np.stack([np.minimum(first, last), np.maximum(first, last)])


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
    along = (hole.left - 0.06, hole.right + 0.06)
    sill = block(room, wall, along, (hole.bottom - 0.03, hole.bottom), (-REVEAL_M, 0.03))
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
    up = UP * (top - bottom)
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
        sheet(room.at(wall, hole.left, hole.top), -inward * depth, -UP * rise),
        sheet(room.at(wall, hole.right, hole.top, -depth), inward * depth, -UP * rise),
        sheet(room.at(wall, hole.left, hole.top), right * (hole.right - hole.left), -inward * depth),
    ]
    if not hole.door:
        corner = room.at(wall, hole.left, hole.bottom, -depth)
        sides.append(sheet(corner, right * (hole.right - hole.left), inward * depth))
    return join(sides)

"""Random placement of objects on the floor, on walls and on each other, without collisions."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from egosplat.geometry import compose, transform
from egosplat_apartments.arrays import Array, Rng
from egosplat_apartments.objects import catalogue
from egosplat_apartments.objects.catalogue import Kind
from egosplat_apartments.objects.model import Model, Surface, bounds_at, boxes_touch, yaw_pose
from egosplat_apartments.world.room import Room, opening_box

# Random places tried for an object before it is left out.
_TRIES = 60

_GAP_M = 0.03

_CHAIR_GAP_M = 0.05


@dataclass(frozen=True)
class Placed:
    """A placed object.

    Attributes:
        kind, model: its kind and shape; number: its index in the apartment.
        pose: (4, 4) float64 ``world_from_object``.
        support: number of the object that it stands on, None for floor and walls; surface: the surface used.
    """

    number: int
    kind: Kind
    model: Model
    pose: Array
    support: int | None = None
    surface: Surface | None = None

    @cached_property
    def bounds(self) -> Array:
        """(2, 3) box in world axes [m]."""
        return np.stack(bounds_at(self.model, self.pose))


@dataclass
class Layout:
    """A room while it is being furnished."""

    room: Room
    placed: list[Placed] = field(default_factory=list)
    keep_clear: list[Array] = field(default_factory=list)

    def of(self, kind: Kind) -> list[Placed]:
        """All objects of a kind."""
        return [thing for thing in self.placed if thing.kind == kind]

    def is_free(self, bounds: Array, ignore: set[int | None]) -> bool:
        """Whether a (2, 3) box lies in the room and touches no object except those numbered in ``ignore``."""
        half = np.array([self.room.width / 2, np.inf, self.room.depth / 2])
        if (
            (bounds[0] < -half - 1e-6).any()
            or (bounds[1] > half + 1e-6).any()
            or bounds[1, 1] > self.room.height - 0.05
        ):
            return False
        # Boxes stand in for shapes.
        others = [thing.bounds for thing in self.placed if thing.number not in ignore] + [*self.room.blocks]
        return not any(boxes_touch(bounds, other, 0.01) for other in others)


def place_kind(layout: Layout, kind: Kind, model: Model, rng: Rng) -> bool:
    """Find a place for an object and put it there; False if there is none."""
    for _ in range(_TRIES):
        found = _propose(layout, kind, model, rng)
        if found is None:
            continue
        pose, support, surface = found
        thing = Placed(len(layout.placed), kind, model, pose, support, surface)
        if _fits(layout, thing):
            layout.placed.append(thing)
            return True
    return False


def _fits(layout: Layout, thing: Placed) -> bool:
    """Whether the object touches nothing, hides no window and keeps passages open."""
    if not layout.is_free(thing.bounds, {thing.support}):
        return False
    if thing.support is not None:
        return True
    if any(boxes_touch(thing.bounds, area, 0.0) for area in layout.keep_clear):
        return False
    return thing.kind.place == "window" or not any(
        boxes_touch(thing.bounds, opening_box(layout.room, opening), 0.02) for opening in layout.room.openings
    )


Proposal = tuple[Array, int | None, Surface | None]


def _propose(layout: Layout, kind: Kind, model: Model, rng: Rng) -> Proposal | None:
    """Propose a random place; None if this attempt found none."""
    if kind.stands_on:
        return _on_surface(layout, kind, model, rng)
    match kind.place:
        case "back":
            return _at_wall(layout, kind, model, rng), None, None
        case "table front":
            return _before(layout.of(catalogue.COUCH)[0], model, rng), None, None
        case "middle":
            return _in_the_middle(layout.room, rng), None, None
        case "chair":
            tables = layout.of(catalogue.DINING_TABLE)
            return (_at_table(tables[0], model, rng), None, None) if tables else None
        case "floor":
            return _near_wall(layout.room, model, rng), None, None
        case "wall":
            return _on_wall(layout.room, kind, model, rng), None, None
        case _:
            return _beside_window(layout.room, model, rng), None, None


def _extent(model: Model, yaw: float = 0.0) -> tuple[Array, Array]:
    return bounds_at(model, yaw_pose(yaw, np.zeros(3)))


def _wall_yaw(room: Room, wall: int) -> float:
    x, _, z = room.normal(wall)
    return float(np.arctan2(x, z))


def _at_wall(layout: Layout, kind: Kind, model: Model, rng: Rng) -> Array:
    """Back to a wall; the TV stand preferably opposite the couch."""
    room, wall = layout.room, int(rng.integers(4))
    if kind == catalogue.TV_STAND and rng.random() < 0.8:
        facing = layout.of(catalogue.COUCH)[0].pose[:3, 2]
        wall = int(np.argmax([-(room.normal(k) * facing).sum() for k in range(4)]))
    lower, upper = _extent(model)
    along = rng.uniform(-lower[0] + _GAP_M, room.length(wall) - upper[0] - _GAP_M)
    return yaw_pose(_wall_yaw(room, wall), room.at(wall, along, 0.0, -lower[2] + 0.02))


def _before(couch: Placed, model: Model, rng: Rng) -> Array:
    """In front of the couch, with its long side along it."""
    lower, _ = _extent(model)
    front = bounds_at(couch.model, np.eye(4))[1][2]
    local = np.array([rng.uniform(-0.15, 0.15), 0.0, front + rng.uniform(0.28, 0.36) - lower[2]])
    pose = couch.pose.copy()
    pose[:3, 3] = transform(couch.pose, local)
    return pose


def _in_the_middle(room: Room, rng: Rng) -> Array:
    place = rng.uniform(-0.5, 0.5, 2) * (room.width - 1.4, room.depth - 1.4)
    return yaw_pose(float(rng.integers(2)) * np.pi / 2, np.array([place[0], 0.0, place[1]]))


def _at_table(table: Placed, model: Model, rng: Rng) -> Array:
    """At one of the table's sides, roughly straight."""
    lower, upper = bounds_at(table.model, np.eye(4))
    side, seat = int(rng.integers(4)), _extent(model)[1][2]
    away = seat + _CHAIR_GAP_M
    slide = 0.25 * (upper[0] - lower[0])
    spots = (
        (rng.choice([-slide, slide]), upper[2] + away, np.pi),
        (rng.choice([-slide, slide]), lower[2] - away, 0.0),
        (upper[0] + away, 0.0, -np.pi / 2),
        (lower[0] - away, 0.0, np.pi / 2),
    )
    x, z, yaw = spots[side]
    local = yaw_pose(float(yaw + rng.uniform(-0.1, 0.1)), np.array([x, 0.0, z]))
    return compose(table.pose, local)


def _near_wall(room: Room, model: Model, rng: Rng) -> Array:
    """On the floor near a wall, facing the room, turned a little."""
    wall = int(rng.integers(4))
    yaw = _wall_yaw(room, wall) + rng.uniform(-0.4, 0.4)
    lower, upper = _extent(model, yaw)
    reach = max(-lower.min(), upper[0], upper[2])
    along = rng.uniform(reach, room.length(wall) - reach)
    return yaw_pose(yaw, room.at(wall, along, 0.0, reach + rng.uniform(0.03, 0.12)))


def _on_wall(room: Room, kind: Kind, model: Model, rng: Rng) -> Array:
    wall = int(rng.integers(4))
    lower, upper = _extent(model)
    along = rng.uniform(-lower[0] + 0.05, room.length(wall) - upper[0] - 0.05)
    height = {"shelf": rng.uniform(1.15, 1.4), "wall-mounted coat rack": rng.uniform(1.55, 1.7)}.get(
        kind.category, rng.uniform(1.45, 1.75)
    )
    return yaw_pose(_wall_yaw(room, wall), room.at(wall, along, height, 0.002))


def _beside_window(room: Room, model: Model, rng: Rng) -> Array:
    hole = room.windows[rng.integers(len(room.windows))]
    lower, upper = _extent(model)
    along = hole.left - upper[0] + 0.16 if rng.random() < 0.5 else hole.right - lower[0] - 0.16
    return yaw_pose(
        _wall_yaw(room, hole.wall), room.at(hole.wall, along, min(hole.top + 0.12, room.height - 0.1), 0.035)
    )


def _on_surface(layout: Layout, kind: Kind, model: Model, rng: Rng) -> Proposal | None:
    """At a random place on a surface that suits the kind."""
    choices = [
        (thing, surface)
        for thing in layout.placed
        for surface in thing.model.surfaces
        if surface.use in kind.stands_on and surface.headroom > _extent(model)[1][1]
    ]
    # The television would block a person's reach to an object behind or next to it.
    choices = [one for one in choices if not kind.hand or one[0].kind != catalogue.TV_STAND] or choices
    if not choices:
        return None
    thing, surface = choices[rng.integers(len(choices))]
    pose = on_surface(thing, surface, kind, model, rng)
    return None if pose is None else (pose, thing.number, surface)


def on_surface(thing: Placed, surface: Surface, kind: Kind, model: Model, rng: Rng) -> Array | None:
    """A pose for a model on another object's surface; None if it is too large.

    An object with a front faces roughly the same way as its support.
    """
    aligned = surface.use != "table"
    yaw = rng.uniform(-0.05, 0.05) if aligned else rng.uniform(-0.6, 0.6)
    lower, upper = _extent(model, yaw := 0.0 if surface.use in ("television", "bed") else yaw)
    room_low = np.array(surface.lower) - lower[[0, 2]]
    room_high = np.array(surface.upper) - upper[[0, 2]]
    if (room_high < room_low).any():
        return None
    if surface.use in ("television", "bed"):
        x, z = (room_low + room_high) / 2
    else:
        x, z = rng.uniform(room_low, room_high)
    return compose(thing.pose, yaw_pose(float(yaw), np.array([x, surface.height + 0.001, z])))

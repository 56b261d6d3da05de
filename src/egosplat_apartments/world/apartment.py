"""A randomly furnished apartment: the room, its objects, and their names and ids in ADT's style."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from egosplat.errors import UserError
from egosplat_apartments.adt_format.sequence import Instance
from egosplat_apartments.arrays import Rng
from egosplat_apartments.objects.catalogue import CATEGORY_UIDS, CORE, Kind, Motion, random_ids, wish_list
from egosplat_apartments.objects.model import Model, bounds_at
from egosplat_apartments.objects.shapes import Part
from egosplat_apartments.world.floorplan import FloorPlan, floor_plan
from egosplat_apartments.world.layout import Layout, Placed, place_kind
from egosplat_apartments.world.room import Room, opening_box, random_room
from egosplat_apartments.world.shell import build_shell

_LAYOUTS = 200
_LEAST_WALK_M2 = 2.5


@dataclass(frozen=True)
class Apartment:
    """A room with its objects at the beginning of the recording.

    Attributes:
        room: its size and openings; shell: its parts, in world axes.
        things: the objects, by number.
        instances: the shell's instance, then one for each of ``things``, in their order.
        plan: the walkable floor.
    """

    room: Room
    shell: tuple[Part, ...]
    things: tuple[Placed, ...]
    instances: tuple[Instance, ...]
    plan: FloorPlan


@dataclass(frozen=True)
class Style:
    """What distinguishes the apartments of a world: how the room is made, what its surfaces look like, and its things."""

    room: Callable[[Rng], Room] = random_room
    shell: Callable[[Room, Rng], list[Part]] = build_shell
    wishes: Callable[[Rng, int], list[Kind]] = wish_list
    build: Callable[[Kind, Rng], Model] = lambda kind, rng: kind.build(rng)


USUAL = Style()


def make_apartment(rng: Rng, objects: int, style: Style = USUAL) -> Apartment:
    """Furnish an apartment.

    Args:
        objects: number of labeled objects, without the shell; 16 or more.
        style: of the world.

    Raises:
        UserError: the objects do not fit.
    """
    for _ in range(_LAYOUTS):
        layout = _furnish(style.room(rng), rng, objects, style)
        if layout is None:
            continue
        plan = floor_plan(layout)
        if plan.walkable_m2 >= _LEAST_WALK_M2 and plan.reaches_door:
            shell = tuple(style.shell(layout.room, rng))
            return Apartment(
                layout.room, shell, tuple(layout.placed), tuple(_instances(layout, shell, rng)), plan
            )
    raise UserError(
        f"synthetic.objects = {objects}: they fit into none of {_LAYOUTS} rooms. "
        "Use fewer, or another synthetic.seed."
    )


def _furnish(room: Room, rng: Rng, objects: int, style: Style) -> Layout | None:
    """A layout with exactly ``objects`` objects, including ``CORE``; None if they do not fit."""
    layout = Layout(room)
    layout.keep_clear.append(opening_box(room, room.door))
    models: dict[str, Model] = {}
    variants: Counter[str] = Counter()
    for kind in style.wishes(rng, objects):
        if kind.varied or kind.prototype not in models:
            models[kind.prototype] = style.build(kind, rng)
        number = f"{variants[kind.prototype] + 1:02d}" if kind.varied else ""
        named = replace(kind, prototype=f"{kind.prototype}{number}")
        if place_kind(layout, named, models[kind.prototype], rng):
            variants[kind.prototype] += 1
        elif kind in CORE:
            return None
        if len(layout.placed) == objects:
            return layout
    return None


def _instances(layout: Layout, shell: tuple[Part, ...], rng: Rng) -> list[Instance]:
    ids = random_ids(rng, len(layout.placed) + 1)
    counts: Counter[str] = Counter()
    instances = [_instance(ids[0], "ApartmentEnv", "ApartmentEnv", "shelter", "static", Model(shell))]
    for uid, thing in zip(ids[1:], layout.placed, strict=True):
        kind = thing.kind
        counts[kind.prototype] += 1
        name = f"{kind.prototype}_{counts[kind.prototype]}"
        instances.append(_instance(uid, name, kind.prototype, kind.category, kind.motion_type, thing.model))
    return instances


def _instance(uid: int, name: str, prototype: str, category: str, motion: Motion, model: Model) -> Instance:
    bounds = np.stack(bounds_at(model, np.eye(4)))
    return Instance(uid, name, prototype, category, CATEGORY_UIDS[category], motion, "object", bounds)

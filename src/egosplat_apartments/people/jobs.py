"""Errands: a person carries an object from its place to another piece of furniture."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from egosplat_apartments.arrays import Array, Rng
from egosplat_apartments.objects.catalogue import TV_STAND
from egosplat_apartments.objects.model import Surface, bounds_at
from egosplat_apartments.people.smooth import smoothstep
from egosplat_apartments.world.apartment import Apartment
from egosplat_apartments.world.floorplan import FloorPlan
from egosplat_apartments.world.layout import Layout, Placed, on_surface

_REACH_M = 0.78
_TRIES = 400
# Time from the start of a reach to the grip, and from the release until the arm hangs again.
REACHING_S = 0.9
LIFTING_S = 0.7


@dataclass(frozen=True)
class Errand:
    """An object, its destination, and where a person stands to pick it up and put it down.

    Attributes:
        thing: the object at its first place; target: (4, 4) final pose; support: number of its final support.
        pick_stand, put_stand: (2,) x and z.
        route: (N, 2) route between them.
    """

    thing: Placed
    target: Array
    support: int
    pick_stand: Array
    put_stand: Array
    route: Array

    @property
    def walk_m(self) -> float:
        """Length of the route."""
        return float(np.linalg.norm(np.diff(self.route, axis=0), axis=1).sum())


@dataclass(frozen=True)
class Job:
    """A scheduled errand, with the times of the grip and of the release [s]."""

    errand: Errand
    grip_s: float
    release_s: float

    def reach(self, times: Array, reaching_s: float = REACHING_S) -> Array:
        """(N,) 0..1: how far the arms are stretched to the object; 1 while they hold it."""
        begun, left = times - self.grip_s, self.release_s - times
        return smoothstep(begun / reaching_s + 1) * smoothstep(left / reaching_s + 1)

    def bend(self, times: Array) -> tuple[Array, Array]:
        """(N,) 0..1 each: how far the person bends to pick the object up, and to put it down."""
        return tuple(
            smoothstep((times - moment) / REACHING_S + 1) * smoothstep((moment - times) / REACHING_S + 1)
            for moment in (self.grip_s, self.release_s)
        )  # type: ignore[return-value]

    def held(self, times: Array) -> Array:
        """(N,) 0..1: lift of the object from its place into the carrying position and back."""
        begun, left = times - self.grip_s, self.release_s - times
        return smoothstep(begun / LIFTING_S) * smoothstep(left / LIFTING_S)


def stands_of(errands: Sequence[Errand]) -> list[Array]:
    """(2,) x and z of each place where a person stops for the errands, in order."""
    return [stand for errand in errands for stand in (errand.pick_stand, errand.put_stand)]


def find_errands(apartment: Apartment, rng: Rng, count: int) -> list[Errand]:
    """Up to ``count`` feasible errands, in random order."""
    layout = Layout(apartment.room, list(apartment.things))
    carriable, surfaces = carriable_things(apartment), surfaces_in_reach(apartment)
    errands: list[Errand] = []
    for _ in range(_TRIES if carriable else 0):
        thing = carriable[rng.integers(len(carriable))]
        support, surface = surfaces[rng.integers(len(surfaces))]
        errand = make_errand(layout, apartment.plan, thing, support, surface, rng)
        if errand is not None:
            errands.append(errand)
        if len(errands) == count:
            break
    return errands


def carriable_things(apartment: Apartment) -> list[Placed]:
    """The objects that a person can pick up."""
    things = [thing for thing in apartment.things if thing.kind.hand]
    return [thing for thing in things if _in_reach(apartment, thing.support, thing.surface)]


def surfaces_in_reach(apartment: Apartment) -> list[tuple[Placed, Surface]]:
    """The surfaces on which a person can put an object, with the object that each belongs to."""
    return [
        (thing, surface)
        for thing in apartment.things
        for surface in thing.model.surfaces
        if _in_reach(apartment, thing.number, surface)
    ]


def _in_reach(apartment: Apartment, support: int | None, surface: Surface | None) -> bool:
    """Whether a person can put an object there without meeting a shelf above or the television."""
    if support is None or surface is None:
        return False
    kind = apartment.things[support].kind
    return (
        surface.use in ("table", "soft")
        and surface.height < 1.0
        and kind.place != "wall"
        and kind != TV_STAND
    )


def make_errand(
    layout: Layout, plan: FloorPlan, thing: Placed, support: Placed, surface: Surface, rng: Rng
) -> Errand | None:
    """An errand that puts a thing at a random free place on a surface; None if that place does not suit."""
    if support.number == thing.support:
        return None
    target = on_surface(support, surface, thing.kind, thing.model, rng)
    if target is None or not layout.is_free(
        np.stack(bounds_at(thing.model, target)), {support.number, thing.number}
    ):
        return None
    ends = [pose[[0, 2], 3] for pose in (thing.pose, target)]
    stands = [plan.nearest(end) for end in ends]
    if max(np.linalg.norm(end - stand, axis=-1) for end, stand in zip(ends, stands, strict=True)) > _REACH_M:
        return None
    return Errand(thing, target, support.number, stands[0], stands[1], plan.route(stands[0], stands[1]))

"""Chores of two people in a busy world: each carries one object after another, to several places where it rests."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from egosplat_apartments.arrays import Array, Rng
from egosplat_apartments.people.jobs import (
    LIFTING_S,
    REACHING_S,
    Errand,
    Job,
    carriable_things,
    make_errand,
    stands_of,
    surfaces_in_reach,
)
from egosplat_apartments.people.motion import (
    SHOULDERS_BEHIND_M,
    HeadMotion,
    long_enough,
    looking_around,
    tour_of,
)
from egosplat_apartments.people.people import OTHER_HOLD
from egosplat_apartments.people.walk import Route, Visit, Walk, make_route, make_walk
from egosplat_apartments.world.apartment import Apartment
from egosplat_apartments.world.layout import Layout, Placed
from egosplat_apartments.world.room import hidden_place

# From how much work on [s] people carry many things, and any: objects of the wearer and of the visitor, and times each.
MANY_FROM_S, LEAST_WORK_S = 40.0, 24.0
_MANY, _FEW = (3, 3, 3), (1, 2, 2)
# When the visitor sets out from the corridor [s].
_COMES_S = (-6.0, -2.0)
LONGEST_REST_S = 10.0
# Rests from which people choose, if the way is no longer [s]: the visitor has one object less and leaves more time.
_OWN_RESTS_S, _OTHER_RESTS_S = (3.1, 4.2), (3.1, 8.0)
# Shortest and longest way with an object [m].
_WAYS_M = (0.7, 3.2)
_SPEED_M_S, _TOUR_M_S, _TURN_PER_S = 1.1, 0.5, 2.0
# A person stands from the arrival to the grip or release, and from there to the departure [s].
_LOWERING_S, _LIFTED_S, _LOWERED_S = 0.7, 0.5, 0.8
# Waits before a way that another person blocks [s].
_WAITS_S = (0.0, 0.6, 1.2, 1.8, 2.4, 3.2, 4.0)
# Least distance between two people, and how long a person needs to leave a place [s].
_KEEP_APART_M, _STAY_S = 0.62, 2.0
# Time from the start of the wearer's reach to the grip [s]: the hands of busy people are rarely out of sight.
REACH_S = 1.4
# Where the wearer holds an object, forward and up from the walk's place, and half the size of a held object [m].
HOLD, _HELD_M = (0.34, 1.26), 0.1
_TRIES, _PLANS, _VISITS = 300, 30, 12

Chore = tuple[Errand, ...]
Clear = Callable[[Array, Array], bool]


def plan_chores(
    apartment: Apartment, rng: Rng, seconds: float, work_s: float
) -> tuple[HeadMotion, Visit] | None:
    """Plan the chores of the wearer and of a visitor within the first ``work_s`` of a recording; None if none fit."""
    watches = work_s < MANY_FROM_S  # the visitor, for which a wearer with many things has no time
    owns, objects, carries = _FEW if watches else _MANY
    chores = find_chores(apartment, rng, 3 * objects, carries)
    for _ in range(_PLANS if len(chores) > owns + objects - 2 else 0):
        mixed = [chores[number] for number in rng.permutation(len(chores))]
        own, others = mixed[:owns], mixed[owns : owns + objects]
        head = _wearer(apartment, own, rng, seconds, work_s)
        # A visitor who finds no time for as many objects carries one less.
        for some in (others, others[: objects - 1]):
            visitor = head and _visitor(apartment, some, rng, head, seconds, work_s)
            if head and visitor and watches:
                span, jobs = (-1.0, seconds + 1.0), [*head.jobs]
                head = looking_around(apartment, head.walk, jobs, rng, span, _TURN_PER_S, visitor[0])
            if head and visitor and not _grazes(apartment, head.walk, head.jobs, HOLD):
                return head, visitor
    return None


def find_chores(apartment: Apartment, rng: Rng, objects: int, carries: int) -> list[Chore]:
    """Up to so many objects, each with the errands that carry it from place to place.

    No place is used twice: where an object rests at some time, no other one ever does.
    """
    layout = Layout(apartment.room, list(apartment.things))
    chores: list[Chore] = []
    things = carriable_things(apartment)
    for thing in (things[number] for number in rng.permutation(len(things))):
        before, errands = len(layout.placed), _chore(apartment, layout, thing, rng, carries)
        if len(errands) < carries:
            del layout.placed[before:]
            continue
        chores.append(tuple(errands))
        if len(chores) == objects:
            break
    return chores


def _chore(apartment: Apartment, layout: Layout, thing: Placed, rng: Rng, carries: int) -> list[Errand]:
    """Errands that carry a thing on and on; each of its places is added to ``layout``."""
    surfaces, errands = surfaces_in_reach(apartment), list[Errand]()
    for _ in range(_TRIES):
        support, surface = surfaces[rng.integers(len(surfaces))]
        if np.linalg.norm(support.pose[:3, 3] - thing.pose[:3, 3]) > _WAYS_M[1] + 0.5:
            continue
        errand = make_errand(layout, apartment.plan, thing, support, surface, rng)
        if errand is None or not _WAYS_M[0] < errand.walk_m < _WAYS_M[1]:
            continue
        errands.append(errand)
        thing = replace(thing, pose=errand.target, support=support.number, surface=surface)
        layout.placed.append(thing)
        if len(errands) == carries:
            break
    return errands


def _orders(chores: Sequence[Chore], rng: Rng) -> Iterator[list[Errand]]:
    """Random orders of errands: one object after the other, or two in turn and then the third."""
    for _ in range(_VISITS):
        mixed = [chores[number] for number in rng.permutation(len(chores))]
        if len(mixed) > 1 and rng.random() < 0.5:
            first = [errand for pair in zip(mixed[0], mixed[1], strict=True) for errand in pair]
            yield [*first, *(errand for chore in mixed[2:] for errand in chore)]
        else:
            yield [errand for chore in mixed for errand in chore]


def _wearer(
    apartment: Apartment, chores: Sequence[Chore], rng: Rng, seconds: float, work_s: float
) -> HeadMotion | None:
    """The wearer does the chores and then walks around the room."""
    plan, span = apartment.plan, (-1.0, seconds + 1.0)
    tour = tour_of(plan, rng)
    for order in _orders(chores, rng):
        after = long_enough(plan, tour, order[-1].put_stand, _TOUR_M_S * seconds + 1.0, 1)
        start = min(tour, key=lambda place: float(np.linalg.norm(place - order[0].pick_stand)))
        route = make_route(plan, [start, *stands_of(order), *after[1:]])
        schedule = _schedule(
            route, order, 1.0, lambda times, places: True, rng.uniform(*_OWN_RESTS_S, len(order))
        )
        if schedule is None or schedule.jobs[-1].release_s > work_s:
            continue
        times, along, jobs = schedule.times, schedule.along, list(schedule.jobs)
        end = max(span[1], times[-1] + 1.0)
        stops = np.array([*times, end]), np.array([*along, along[-1] + _TOUR_M_S * (end - times[-1])])
        walk = make_walk(route, *stops, jobs, span, SHOULDERS_BEHIND_M)
        head = looking_around(apartment, walk, jobs, rng, span, _TURN_PER_S)
        if not _grazes(apartment, head.walk, jobs, HOLD):
            return head
    return None


def _visitor(
    apartment: Apartment, chores: Sequence[Chore], rng: Rng, head: HeadMotion, seconds: float, work_s: float
) -> Visit | None:
    """A visitor comes through the door, does the chores, out of the wearer's way, and leaves."""
    hidden, span = hidden_place(apartment.room), (-1.5, seconds + 1.5)

    def clear(times: Array, places: Array) -> bool:
        wearer = head.walk.place(np.clip(times, *span))
        return bool(np.linalg.norm(places - wearer, axis=1).min() > _KEEP_APART_M)

    for order in _orders(chores, rng):
        route = make_route(apartment.plan, [hidden, *stands_of(order), hidden])
        schedule = _schedule(
            route, order, float(rng.uniform(*_COMES_S)), clear, rng.uniform(*_OTHER_RESTS_S, len(order))
        )
        if schedule is None or schedule.jobs[-1].release_s > work_s:
            continue
        leave, way = schedule.times[-1], route.length - schedule.along[-1]
        times = np.array([-60.0, *schedule.times, leave + way / _SPEED_M_S, leave + 60.0])
        along = np.array([0.0, *schedule.along, route.length, route.length])
        walk = make_walk(route, times, along, list(schedule.jobs), span)
        moments = np.arange(0, seconds, 0.2)
        met = not clear(moments, walk.place(moments))
        if not (met or _grazes(apartment, walk, schedule.jobs, OTHER_HOLD)):
            return walk, schedule.jobs
    return None


def _grazes(apartment: Apartment, walk: Walk, jobs: Sequence[Job], hold: tuple[float, float]) -> bool:
    """Whether an object in somebody's hands meets a wall or a thing that nobody carries."""
    carried = {job.errand.thing.number for job in jobs}
    boxes = [thing.bounds for thing in apartment.things if thing.number not in carried]
    boxes += [*apartment.room.blocks]
    half = np.array([apartment.room.width / 2, np.inf, apartment.room.depth / 2]) - _HELD_M
    for job in jobs:
        times = np.arange(job.grip_s + LIFTING_S, job.release_s - LIFTING_S, 0.15)
        x, z, heading, _, crouch, _ = walk.track(times).T
        places = np.stack(
            [x + hold[0] * np.sin(heading), hold[1] - crouch, z + hold[0] * np.cos(heading)], -1
        )
        if (np.abs(places) > half).any() or any(
            ((places > box[0] - _HELD_M) & (places < box[1] + _HELD_M)).all(axis=1).any() for box in boxes
        ):
            return True
    return False


@dataclass(frozen=True)
class _Schedule:
    """When a person reaches which distance along a route, and the jobs on the way."""

    times: list[float]
    along: list[float]
    jobs: tuple[Job, ...]


def _schedule(
    route: Route, errands: Sequence[Errand], begin_s: float, clear: Clear, rests_s: Array
) -> _Schedule | None:
    """Run the errands as early as the way is clear; None if it is not, or if an object rests for too long.

    Args:
        rests_s: (E,) how long an errand's object rests at least before it [s].
    """
    times, along, jobs = [begin_s], [0.0], list[Job]()
    released: dict[int, float] = {}
    for number, errand in enumerate(errands):
        pick, put = route.stops[2 * number + 1 : 2 * number + 3].tolist()
        if not _go(route, times, along, pick, clear):
            return None
        grip, thing = times[-1] + REACHING_S, errand.thing.number
        if jobs:
            grip = max(grip, jobs[-1].release_s + 2 * REACH_S)
        grip = max(grip, released.get(thing, 0.0) + float(rests_s[number]))
        if grip > released.get(thing, np.inf) + LONGEST_REST_S:
            return None
        _stand(times, along, grip + _LIFTED_S)
        if not _go(route, times, along, put, clear):
            return None
        released[thing] = times[-1] + _LOWERING_S
        jobs.append(Job(errand, grip, released[thing]))
        _stand(times, along, released[thing] + _LOWERED_S)
    return _Schedule(times, along, tuple(jobs))


def _stand(times: list[float], along: list[float], until: float) -> None:
    times.append(until)
    along.append(along[-1])


def _go(route: Route, times: list[float], along: list[float], goal: float, clear: Clear) -> bool:
    """Go on to ``goal`` after the shortest wait with which the way is clear; False if there is none."""
    for wait in _WAITS_S:
        leave = times[-1] + wait
        arrive = leave + (goal - along[-1]) / _SPEED_M_S
        moments = np.arange(times[-1], arrive + _STAY_S, 0.2)
        if clear(moments, route.at(np.interp(moments, [leave, arrive], [along[-1], goal]))):
            times += [leave, arrive]
            along += [along[-1], goal]
            return True
    return False

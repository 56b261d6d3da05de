"""A furnished apartment, its people, and the pose of everything at any moment."""

from dataclasses import dataclass, replace

import numpy as np

from egosplat.errors import UserError
from egosplat_apartments.adt_format.sequence import Instance, Rest
from egosplat_apartments.arrays import Array, Rng
from egosplat_apartments.camera.raycasting import Body, Geometry, build_geometry
from egosplat_apartments.objects.catalogue import busy_wish_list, random_ids
from egosplat_apartments.objects.foreign import build_foreign
from egosplat_apartments.people.chores import HOLD, LEAST_WORK_S, MANY_FROM_S, REACH_S, plan_chores
from egosplat_apartments.people.figure import random_clothes
from egosplat_apartments.people.jobs import Errand, Job, find_errands
from egosplat_apartments.people.motion import HeadMotion, plan_head
from egosplat_apartments.people.people import Person, make_other, make_wearer, plan_other
from egosplat_apartments.people.walk import Visit
from egosplat_apartments.world.apartment import USUAL, Apartment, Style, make_apartment
from egosplat_apartments.world.foreign import foreign_room, foreign_shell
from egosplat_apartments.world.room import busy_room, random_room

# Worlds by name.
STYLES = {
    "usual": USUAL,
    "busy": Style(room=busy_room, wishes=busy_wish_list),
    "foreign": Style(room=foreign_room, shell=foreign_shell, build=build_foreign),
}

# If people work for less time than this, only the wearer works.
_OTHER_FROM_S = 7.0
_HOMES, _PLANS, _ERRANDS = 8, 6, 30


@dataclass(frozen=True, eq=False)
class World:
    """The full state of a recording before rendering.

    Attributes:
        apartment: the room and its objects; head: the wearer's head; people: the wearer and a visitor.
        geometry: all surfaces; seed: for the randomness of rendering; start_ns: start of the recording.
        kind: name of the world.
    """

    apartment: Apartment
    head: HeadMotion
    people: tuple[Person, ...]
    geometry: Geometry
    seed: int
    start_ns: int
    kind: str = "usual"

    @property
    def instances(self) -> list[Instance]:
        """Instances of the shell, the objects and the people."""
        return [*self.apartment.instances, *(person.instance for person in self.people)]

    def moved_things(self, seconds: float) -> dict[int, Array]:
        """(4, 4) poses of the objects that anybody carries at some time, by object number."""
        return {
            number: pose for person in self.people for number, pose in person.thing_poses(seconds).items()
        }

    def thing_poses(self, seconds: float) -> dict[int, Array]:
        """(4, 4) pose of every object labeled dynamic, by instance id."""
        moved = self.moved_things(seconds)
        things = zip(self.apartment.instances[1:], self.apartment.things, strict=True)
        return {
            one.instance_id: moved.get(thing.number, thing.pose)
            for one, thing in things
            if one.motion_type == "dynamic"
        }

    def rests(self, seconds: float) -> tuple[Rest, ...]:
        """Where each carried object lies, and from when until when, in a recording of this length."""
        ids = [one.instance_id for one in self.apartment.instances[1:]]
        rests = []
        for jobs in self.jobs_of.values():
            ends = [0.0, *(job.release_s for job in jobs)]
            supports = [jobs[0].errand.thing.support, *(job.errand.support for job in jobs)]
            for first, last, support in zip(
                ends, [*(job.grip_s for job in jobs), seconds], supports, strict=True
            ):
                moments = (self.start_ns + round(1e9 * float(np.clip(s, 0, seconds))) for s in (first, last))
                rests.append(Rest(ids[jobs[0].errand.thing.number], ids[support], *moments))
        return tuple(rests)

    @property
    def jobs_of(self) -> dict[int, list[Job]]:
        """The jobs of each carried object in order of time, by object number."""
        jobs = sorted((job for person in self.people for job in person.jobs), key=lambda job: job.grip_s)
        numbers = sorted({job.errand.thing.number for job in jobs})
        return {number: [job for job in jobs if job.errand.thing.number == number] for number in numbers}

    def body_poses(self, seconds: float) -> dict[int, Array]:
        """(4, 4) pose of every body that is not static, by its number in the geometry."""
        moved = self.moved_things(seconds)
        # The order of ``make_world``: the carried things by number, then each person's limbs.
        poses = [moved[number] for number in sorted(moved)]
        poses += [pose for person in self.people for pose in person.limb_poses(seconds, moved)]
        return dict(enumerate(poses, self.geometry.group("static")[1]))


def make_world(
    *, seed: int, seconds: float, objects: int, motion: float, world: str = "usual", walk: int = 0
) -> World:
    """Make the world to be rendered; parameters as for ``make_sequence``."""
    share = float(motion)
    if not 0 <= share <= 1:
        raise ValueError(f"motion is {motion}, not within 0..1")
    layout_rng = np.random.default_rng([seed, 0])
    motion_rng, people_rng = (np.random.default_rng([seed, stream, walk]) for stream in (1, 2))
    if world == "busy" and share > 0:
        apartment, chores = _busy_apartment(layout_rng, motion_rng, objects, seconds, share * seconds)
        head, people = chores[0], _busy_people(apartment, *chores, people_rng)
    else:
        apartment, errands = _apartment(layout_rng, objects, share > 0, STYLES[world])
        head, people = _plan_motion(apartment, errands, motion_rng, people_rng, seconds, share * seconds)
    carried = {job.errand.thing.number for person in people for job in person.jobs}
    bodies = [Body(apartment.instances[0].instance_id, apartment.shell, np.eye(4), "static")]
    for one, thing in zip(apartment.instances[1:], apartment.things, strict=True):
        role = "thing" if thing.number in carried else "static"
        bodies.append(Body(one.instance_id, thing.model.parts, thing.pose, role))
    bodies += [body for person in people for body in person.bodies()]
    start_ns = 80_000_000_000_000 + int(motion_rng.integers(20_000_000_000_000))
    return World(apartment, head, people, build_geometry(bodies), seed, start_ns, world)


def _apartment(rng: Rng, objects: int, at_work: bool, style: Style) -> tuple[Apartment, list[Errand]]:
    """An apartment and, if ``at_work``, at least one errand for people to run."""
    for _ in range(_HOMES):
        apartment = make_apartment(rng, objects, style)
        errands = find_errands(apartment, rng, _ERRANDS) if at_work else []
        if errands or not at_work:
            return apartment, errands
    raise UserError(
        f"synthetic.objects = {objects}: in {_HOMES} apartments no object can be carried. "
        "Use another number or another synthetic.seed."
    )


def _busy_apartment(
    rng: Rng, motion_rng: Rng, objects: int, seconds: float, work_s: float
) -> tuple[Apartment, tuple[HeadMotion, Visit]]:
    """A busy apartment, and what its people do for ``work_s`` seconds."""
    # Things that are carried for a short time stay near in a room of the usual size.
    style = replace(STYLES["busy"], room=busy_room if work_s >= MANY_FROM_S else random_room)
    # Less work is never enough, so no apartment is tried.
    for _ in range(_HOMES if work_s >= LEAST_WORK_S else 0):
        apartment = make_apartment(rng, objects, style)
        chores = plan_chores(apartment, motion_rng, seconds, work_s)
        if chores is not None:
            return apartment, chores
    raise UserError(
        f"synthetic.world = busy: two people find no time or room to carry things about in {work_s:g} s of work. "
        f"Use synthetic.motion=1 with synthetic.seconds={LEAST_WORK_S:g} or more, or another synthetic.seed."
    )


def _busy_people(apartment: Apartment, head: HeadMotion, visit: Visit, rng: Rng) -> tuple[Person, ...]:
    first, second = _new_ids(apartment, rng)[:2]
    wearer = make_wearer(first, head, random_clothes(rng))
    wearer = replace(wearer, hold=HOLD, both_hands=True, reaching_s=REACH_S)
    return wearer, make_other(second, visit, random_clothes(rng))


def _plan_motion(
    apartment: Apartment, errands: list[Errand], rng: Rng, people_rng: Rng, seconds: float, work_s: float
) -> tuple[HeadMotion, tuple[Person, ...]]:
    """Plan the wearer's way and the second person for ``work_s`` seconds of work.

    Some ways of the wearer leave no room for a second person, so several are tried.
    """
    wanted = 0 if work_s <= 0 else 1 if work_s < _OTHER_FROM_S else 2
    wanted_m = float(np.clip(0.5 * (work_s - 3.0), 0.8, 3.0))
    for _ in range(_PLANS):
        few = [errands[k] for k in rng.integers(len(errands), size=8)] if errands else []
        errand = min(few, key=lambda one: abs(one.walk_m - wanted_m), default=None)
        head = plan_head(apartment, rng, seconds, errand)
        people = _people(apartment, errands, people_rng, head, seconds, work_s)
        if len(people) >= wanted:
            break
    return head, people


def _people(
    apartment: Apartment, errands: list[Errand], rng: Rng, head: HeadMotion, seconds: float, work_s: float
) -> tuple[Person, ...]:
    """The wearer and, for longer work, a second person; nobody without work."""
    if work_s <= 0:
        return ()
    ids = _new_ids(apartment, rng)
    people = [make_wearer(ids[0], head, random_clothes(rng))]
    if work_s >= _OTHER_FROM_S and (plan := plan_other(apartment, errands, rng, head, seconds, work_s)):
        people.append(make_other(ids[1], plan, random_clothes(rng)))
    return tuple(people)


def _new_ids(apartment: Apartment, rng: Rng) -> list[int]:
    """At least two ids that no object has."""
    used = {one.instance_id for one in apartment.instances}
    return [uid for uid in random_ids(rng, 4) if uid not in used]


def camera_pose(world: World, seconds: float) -> Array:
    """(4, 4) ``world_from_camera``, sensor orientation, at a time of the recording."""
    return world.head.world_from_camera(np.array([seconds]))[0]

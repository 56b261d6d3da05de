"""A synthetic recording: an apartment at random, a walk through it, people at work, and what the camera sees."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import CLOCKWISE
from egosplat.synthetic.apartment import Apartment, make_apartment
from egosplat.synthetic.catalogue import random_ids
from egosplat.synthetic.jobs import Errand, find_errands
from egosplat.synthetic.lighting import make_lights
from egosplat.synthetic.limbs import random_clothes
from egosplat.synthetic.motion import HeadMotion, plan_head
from egosplat.synthetic.people import Person, make_other, make_wearer, plan_other
from egosplat.synthetic.points import semidense_points
from egosplat.synthetic.raycasting import Body, Geometry, build_geometry
from egosplat.synthetic.render import Renderer
from egosplat.synthetic.sequence import ROLLING_SHUTTER_MIDDLE_NS, Frame, Instance, Sequence

Array = NDArray[np.float64]

MOTIONS = {"none": 0.0, "low": 0.25, "high": 1.0}
_OTHER_FROM_S = 7.0
"""Work of less time than this is done by the wearer alone."""
_PLANS = 6
_MARGIN_NS = 200_000_000
_EXPOSURE_S = 0.0045


@dataclass(frozen=True, eq=False)
class World:
    """Everything that is true of a recording, before anything is rendered.

    Attributes:
        apartment: the room and its things; head: the wearer's; people: who else moves, and the wearer's arms.
        geometry: all surfaces; seed: of whatever is left to chance in rendering; start_ns: of the recording.
    """

    apartment: Apartment
    head: HeadMotion
    people: tuple[Person, ...]
    geometry: Geometry
    seed: int
    start_ns: int

    @property
    def instances(self) -> list[Instance]:
        """Of the shell, the things and the people."""
        return [*self.apartment.instances, *(person.instance for person in self.people)]

    def moved_things(self, seconds: float) -> dict[int, Array]:
        """(4, 4) poses of the things that anybody carries at some time, by their number."""
        return {
            number: pose for person in self.people for number, pose in person.thing_poses(seconds).items()
        }

    def thing_poses(self, seconds: float) -> dict[int, Array]:
        """(4, 4) pose of every thing labelled dynamic, by instance id."""
        moved = self.moved_things(seconds)
        things = zip(self.apartment.instances[1:], self.apartment.things, strict=True)
        return {
            one.instance_id: moved.get(thing.number, thing.pose)
            for one, thing in things
            if one.motion_type == "dynamic"
        }

    def body_poses(self, seconds: float) -> dict[int, Array]:
        """(4, 4) pose of every body that is not static, by its number in the geometry."""
        moved = self.moved_things(seconds)
        uid_of = {
            thing.number: one.instance_id
            for one, thing in zip(self.apartment.instances[1:], self.apartment.things, strict=True)
        }
        by_id = {uid_of[number]: iter([pose]) for number, pose in moved.items()}
        by_id |= {
            person.instance.instance_id: iter(person.limb_poses(seconds, moved)) for person in self.people
        }
        first = self.geometry.group("static")[1]
        return {
            number: next(by_id[body.instance_id])
            for number, body in enumerate(self.geometry.bodies)
            if number >= first
        }


def make_world(*, seed: int, seconds: float, objects: int, motion: float | str) -> World:
    """Everything but the pictures; the parameters are ``make_sequence``'s."""
    share = MOTIONS[motion] if isinstance(motion, str) else float(motion)
    if not 0 <= share <= 1:
        raise ValueError(f"motion is {motion}, not within 0..1")
    layout_rng, motion_rng, people_rng = (np.random.default_rng([seed, stream]) for stream in range(3))
    apartment = make_apartment(layout_rng, objects)
    head, people = _plan_motion(apartment, motion_rng, people_rng, seconds, share * seconds)
    carried = {job.errand.thing.number for person in people for job in person.jobs}
    bodies = [Body(apartment.instances[0].instance_id, apartment.shell, np.eye(4), "static")]
    for one, thing in zip(apartment.instances[1:], apartment.things, strict=True):
        role = "thing" if thing.number in carried else "static"
        bodies.append(Body(one.instance_id, thing.model.parts, thing.pose, role))
    bodies += [body for person in people for body in person.bodies()]
    start_ns = 80_000_000_000_000 + int(motion_rng.integers(20_000_000_000_000))
    return World(apartment, head, people, build_geometry(bodies), seed, start_ns)


def _plan_motion(
    apartment: Apartment,
    rng: np.random.Generator,
    people_rng: np.random.Generator,
    seconds: float,
    work_s: float,
) -> tuple[HeadMotion, tuple[Person, ...]]:
    """The wearer's way and who else is there, for ``work_s`` seconds of work.

    Not every way of the wearer leaves room for a second person; a few are tried.
    """
    wanted = 0 if work_s <= 0 else 1 if work_s < _OTHER_FROM_S else 2
    for _ in range(_PLANS):
        errand = _wearers_errand(apartment, rng, work_s) if work_s > 0 else None
        head = plan_head(apartment, rng, seconds, errand)
        people = _people(apartment, people_rng, head, seconds, work_s)
        if len(people) >= wanted:
            break
    return head, people


def _wearers_errand(apartment: Apartment, rng: np.random.Generator, work_s: float) -> Errand | None:
    """Of several, the one whose way suits the time best."""
    errands = find_errands(apartment, rng, set(), 10)
    wanted = np.clip(0.5 * (work_s - 3.0), 0.8, 3.0)
    return min(errands, key=lambda errand: abs(errand.walk_m - wanted), default=None)


def _people(
    apartment: Apartment, rng: np.random.Generator, head: HeadMotion, seconds: float, work_s: float
) -> tuple[Person, ...]:
    """The wearer and, if there is work for longer, somebody else; nobody where there is no work."""
    if work_s <= 0:
        return ()
    used = {one.instance_id for one in apartment.instances}
    ids = [uid for uid in random_ids(rng, 4) if uid not in used]
    people = [make_wearer(ids[0], head, random_clothes(rng))]
    taken = {job.errand.thing.number for job in head.jobs}
    supports = {job.errand.support for job in head.jobs}
    if work_s >= _OTHER_FROM_S or not head.jobs:
        plan = plan_other(apartment, rng, head, seconds, work_s, taken, supports)
        if plan is not None:
            people.append(make_other(ids[1], plan, random_clothes(rng)))
    return tuple(people)


def make_sequence(
    *,
    name: str,
    seed: int,
    size: int,
    fps: float,
    seconds: float,
    objects: int = 24,
    motion: float | str = 0.5,
) -> Sequence:
    """A recording of a furnished apartment.

    Args:
        name: of the sequence.
        seed: which apartment, which walk; the same seed makes the same recording, bit by bit.
        size: side of the square picture [px]; fps: pictures a second; seconds: length.
        objects: number of nameable things, 16 to 40.
        motion: ``none``, ``low``, ``high``, or the share 0..1 of the time in which people are at work. Carrying
            one thing takes some seconds, so that a short recording may have more.

    Raises:
        ValueError: ``motion`` is out of range, or so many objects find no place.
    """
    world = make_world(seed=seed, seconds=seconds, objects=objects, motion=motion)
    return film(world, make_renderer(world, size), name=name, fps=fps, seconds=seconds)


def film(world: World, renderer: Renderer, *, name: str, fps: float, seconds: float) -> Sequence:
    """The recording of a world; see ``make_sequence``."""
    count = max(1, round(seconds * fps))
    captures = world.start_ns + np.round(np.arange(count) * 1e9 / fps).astype(np.int64)
    points, inv_dist_std, dist_std = semidense_points(
        world, renderer, captures, np.random.default_rng([world.seed, 5])
    )
    poses = [np.eye(4), *(thing.pose for thing in world.apartment.things)]
    things = zip(world.apartment.instances, poses, strict=True)
    return Sequence(
        name=name,
        size=renderer.lens.size,
        fps=fps,
        instances=world.instances,
        world_from_static={one.instance_id: pose for one, pose in things if one.motion_type == "static"},
        device_pose=world.head.device_pose(world.start_ns),
        start_ns=int(captures[0]) - _MARGIN_NS,
        end_ns=int(captures[-1]) + _MARGIN_NS,
        points=points,
        inv_dist_std=inv_dist_std,
        dist_std=dist_std,
        frames=lambda: render_frames(world, renderer, captures),
        frame_count=count,
    )


def make_renderer(world: World, size: int) -> Renderer:
    """The world's surfaces and light, for square pictures of ``size`` pixels."""
    lights = make_lights(world.apartment.room, np.random.default_rng([world.seed, 3]))
    return Renderer(world.geometry, lights, size, np.random.default_rng([world.seed, 4]))


def render_frames(world: World, renderer: Renderer, captures: NDArray[np.int64]) -> Iterator[Frame]:
    """The frames captured at (F,) nanoseconds, one by one."""
    for number, capture_ns in enumerate(captures.tolist()):
        seconds = (capture_ns + ROLLING_SHUTTER_MIDDLE_NS - world.start_ns) * 1e-9
        gain = 1.0 + 0.05 * float(np.sin(0.9 * seconds + world.seed))
        shot = renderer.shoot(
            camera_pose(world, seconds),
            world.body_poses(seconds),
            gain,
            np.random.default_rng([world.seed, 6, number]),
        )
        moved = world.moved_things(seconds)
        yield Frame(
            capture_ns=capture_ns,
            exposure_s=_EXPOSURE_S,
            gain=2.0 * gain,
            rgb=shot.rgb,
            with_people=shot.with_people,
            without_people=shot.without_people,
            world_from_object=world.thing_poses(seconds),
            skeletons={person.instance.instance_id: person.joints(seconds, moved) for person in world.people},
        )


def camera_pose(world: World, seconds: float) -> Array:
    """(4, 4) ``world_from_camera``, sensor orientation, at a moment of the recording."""
    return world.head.world_from_upright(np.array([seconds]))[0] @ np.linalg.inv(CLOCKWISE)

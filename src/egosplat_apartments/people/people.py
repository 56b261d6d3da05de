"""The people in the apartment: the wearer, of whom only the arms are rendered, and a visitor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from egosplat.geometry import make_pose
from egosplat_apartments.adt_format.sequence import Instance
from egosplat_apartments.arrays import Array, Rng
from egosplat_apartments.camera.raycasting import Body
from egosplat_apartments.objects.catalogue import CATEGORY_UIDS
from egosplat_apartments.objects.model import bounds_at
from egosplat_apartments.people.figure import (
    ARMS,
    JOINTS,
    LIMBS,
    Clothes,
    Stance,
    joints_of,
    limb_parts,
    limb_pose,
)
from egosplat_apartments.people.jobs import LIFTING_S, REACHING_S, Errand, Job, stands_of
from egosplat_apartments.people.motion import SHOULDERS_BEHIND_M, HeadMotion
from egosplat_apartments.people.smooth import smoothstep
from egosplat_apartments.people.walk import Route, Visit, Walk, make_route, make_walk
from egosplat_apartments.world.apartment import Apartment
from egosplat_apartments.world.room import hidden_place

_SPEED_M_S = 0.85
_PAUSE_S, _LONGEST_PAUSE_S = 1.9, 4.5
_KEEP_APART_M = 0.58
_ATTEMPTS, _SHIFTS = 30, 10
# Where a visitor holds an object, forward and up from the walk's place.
OTHER_HOLD = (0.34, 0.98)
# Objects wider than twice this are held with both hands.
_OPEN_HAND_M = 0.06


@dataclass(frozen=True)
class Person:
    """A person over the whole recording.

    Attributes:
        instance: ADT's entry; walk: the motion; jobs: scheduled errands; clothes: textures.
        limbs: names of the limbs that are rendered.
        hold: offset forward and up [m] from the walk's place to the carried object.
        behind_m: distance of the body behind the walk's place, which for the wearer is the camera.
        both_hands: whether small objects are held with both hands, too.
        reaching_s: time from the start of a reach to the grip, and from the release until the arm hangs again.
    """

    instance: Instance
    walk: Walk
    jobs: tuple[Job, ...]
    clothes: Clothes
    limbs: tuple[str, ...]
    hold: tuple[float, float]
    behind_m: float
    both_hands: bool = False
    reaching_s: float = REACHING_S

    def bodies(self) -> list[Body]:
        """The limbs as rigid bodies, posed by ``limb_poses``."""
        return [
            Body(self.instance.instance_id, limb_parts(limb, self.clothes), np.eye(4), "person")
            for limb in self.limbs
        ]

    def stance(self, time: float, poses: dict[int, Array]) -> Stance:
        """The posture at a time, with objects at ``poses`` (by object number)."""
        x, z, heading, walked, crouch, lean = self.walk.track(time).tolist()
        x, z = x - self.behind_m * np.sin(heading), z - self.behind_m * np.cos(heading)
        reaches = [float(job.reach(np.array(time), self.reaching_s)) for job in self.jobs]
        busy = int(np.argmax(reaches)) if reaches else -1
        hands: tuple[Array | None, Array | None] = (None, None)
        if busy >= 0 and reaches[busy] > 0:
            pose = poses[self.jobs[busy].errand.thing.number]
            hands = _grip(self.jobs[busy], pose, heading, self.both_hands)
        speed = float(np.abs(self.walk.track(time + 0.05)[3] - self.walk.track(time - 0.05)[3])) / 0.1
        lively = float(smoothstep(speed / 0.5)) * (self.behind_m == 0)
        reach = max(reaches, default=0.0)
        return Stance(np.array([x, z]), heading, walked, crouch, lean, hands, reach, lively)

    def joints(self, time: float, poses: dict[int, Array]) -> Array:
        """(J, 3) positions of ``JOINTS``, in order."""
        joints = joints_of(self.stance(time, poses))
        return np.array([joints[name] for name in JOINTS])

    def limb_poses(self, time: float, poses: dict[int, Array]) -> list[Array]:
        """(4, 4) pose of each of ``bodies``."""
        stance = self.stance(time, poses)
        joints = joints_of(stance)
        return [limb_pose(limb, joints, stance.heading) for limb in self.limbs]

    def thing_poses(self, time: float) -> dict[int, Array]:
        """(4, 4) pose at a time of every object that this person carries at some time, by object number."""
        latest: dict[int, Job] = {}
        for job in self.jobs:
            if job.errand.thing.number not in latest or job.grip_s <= time:
                latest[job.errand.thing.number] = job
        return {number: self._carried(job, time) for number, job in latest.items()}

    def _carried(self, job: Job, time: float) -> Array:
        errand = job.errand
        rest = errand.thing.pose if time < 0.5 * (job.grip_s + job.release_s) else errand.target
        share = float(job.held(np.array(time)))
        if share == 0.0:
            return rest
        x, z, heading, _, crouch, _ = self.walk.track(time).tolist()
        forward, up = self.hold[0], self.hold[1] - crouch
        place = np.array([x + forward * np.sin(heading), up, z + forward * np.cos(heading)])
        # The object keeps its orientation to the body and turns on the way to its final one.
        middle = float(smoothstep((time - job.grip_s) / max(job.release_s - job.grip_s, LIFTING_S)))
        start, end = _yaw(errand.thing.pose), _yaw(errand.target)
        turn = (end - start + np.pi) % (2 * np.pi) - np.pi
        rotation = Rotation.from_euler("y", start + middle * turn).as_matrix()
        lifted = rest[:3, 3] + share * (place - rest[:3, 3])
        # An arc, so that the object does not graze its support.
        lifted[1] += 0.12 * np.sin(np.pi * share) * (1 - share)
        return make_pose(rotation, lifted)


def _yaw(pose: Array) -> float:
    return float(np.arctan2(pose[0, 2], pose[2, 2]))


def _grip(job: Job, pose: Array, heading: float, both: bool) -> tuple[Array | None, Array | None]:
    """Targets of the palms on an object: both sides of it, or only the right one."""
    lower, upper = bounds_at(job.errand.thing.model, pose)
    center = (lower + upper) / 2
    right = np.cross([np.sin(heading), 0.0, np.cos(heading)], [0.0, 1.0, 0.0])
    half = float((np.abs(right) * (upper - lower)).sum()) / 2
    grip = half + 0.015
    size = np.ptp(bounds_at(job.errand.thing.model, np.eye(4)), axis=0)
    small = min(size[0], size[2]) / 2 < _OPEN_HAND_M
    left = None if small and not both else center - grip * right
    return left, center + grip * right


def make_wearer(uid: int, head: HeadMotion, clothes: Clothes) -> Person:
    """The wearer, of whom only the arms are rendered."""
    return Person(
        _human(uid, "Skeleton_W"), head.walk, head.jobs, clothes, ARMS, (0.4, 1.06), SHOULDERS_BEHIND_M
    )


def plan_other(
    apartment: Apartment, errands: list[Errand], rng: Rng, head: HeadMotion, seconds: float, work_s: float
) -> Visit | None:
    """Plan a visitor who comes through the door, carries objects for a while and leaves.

    Of several plans, return the one that keeps farthest from the wearer. The visitor does not touch what the
    wearer carries and puts nothing where the wearer does. None if no plan keeps clear of the wearer.
    """
    times = np.linspace(0, seconds, int(seconds * 5) + 2)
    wearer = head.walk.place(times)
    taken = {job.errand.thing.number for job in head.jobs}
    full = {job.errand.support for job in head.jobs}
    open_errands = [one for one in errands if one.thing.number not in taken and one.support not in full]
    best, farthest, hidden = None, _KEEP_APART_M, hidden_place(apartment.room)
    for attempt in range(_ATTEMPTS):
        # While no plan is found, try with less work.
        share = 1 - attempt / _ATTEMPTS if best is None else 1
        chosen = _errands_for(open_errands, rng, work_s * share)
        if not chosen:
            return None
        route = make_route(apartment.plan, [hidden, *stands_of(chosen), hidden])
        for when in rng.random(_SHIFTS).tolist():
            pauses = rng.uniform(_PAUSE_S, _LONGEST_PAUSE_S, len(route.stops))
            plan = _other_walk(route, chosen, seconds, when, pauses)
            distance = float(np.linalg.norm(plan[0].place(times) - wearer, axis=1).min())
            if distance > farthest:
                best, farthest = plan, distance
        if best is not None and attempt >= _ATTEMPTS // 4:
            break
    return best


def _errands_for(errands: list[Errand], rng: Rng, work_s: float) -> list[Errand]:
    """Errands that fill the time, with different objects and destinations."""
    chosen: list[Errand] = []
    for errand in (errands[number] for number in rng.permutation(len(errands))):
        numbers = {other.thing.number for other in chosen}
        supports = {other.support for other in chosen}
        if errand.thing.number in numbers or errand.support in supports:
            continue
        chosen.append(errand)
        # Roughly the time for an errand and the way to it.
        if sum(2 * _PAUSE_S + (one.walk_m + 2.0) / _SPEED_M_S for one in chosen) > work_s:
            break
    return chosen


def _other_walk(
    route: Route, errands: Sequence[Errand], seconds: float, share: float, pauses: Array
) -> Visit:
    """Walk the route as early (share 0) to as late (share 1) as fits into the recording."""
    clock, times, along = 0.0, [-60.0, 0.0], [0.0, 0.0]
    grips = []
    for before, here, pause in zip(
        route.stops[:-1].tolist(), route.stops[1:].tolist(), pauses.tolist(), strict=False
    ):
        clock += (here - before) / _SPEED_M_S
        times += [clock, clock + pause]
        along += [here, here]
        grips.append(clock + pause - _PAUSE_S + REACHING_S)
        clock += pause
    # The last stop is the hiding place; at the one before, the last object is put down.
    earliest, latest = 0.5 - grips[0], seconds - 0.5 - grips[-2]
    start = earliest + share * (latest - earliest)
    jobs = tuple(
        Job(errand, start + grips[2 * number], start + grips[2 * number + 1])
        for number, errand in enumerate(errands)
    )
    times, along = [*times, clock + 60.0], [*along, route.length]
    first, last = jobs[0].grip_s - 2 * REACHING_S, jobs[-1].release_s + 2 * REACHING_S
    span = (min(-1.5, first), max(seconds + 1.5, last))
    walk = make_walk(route, np.array(times) + start, np.array(along), list(jobs), span)
    return walk, jobs


def make_other(uid: int, plan: Visit, clothes: Clothes) -> Person:
    """The visitor, rendered from head to foot."""
    return Person(_human(uid, "Skeleton_T"), plan[0], plan[1], clothes, tuple(LIMBS), OTHER_HOLD, 0.0)


def _human(uid: int, name: str) -> Instance:
    bounds = np.array([[-0.5, 0.0, -0.5], [0.5, 1.8, 0.5]])
    return Instance(uid, name, "Skeleton", "person", CATEGORY_UIDS["person"], "dynamic", "human", bounds)

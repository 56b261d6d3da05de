"""Motion of the wearer's head: a walk through the room, with gaze at one object after the other."""

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from egosplat.geometry import CLOCKWISE, compose, invert, make_pose
from egosplat_apartments.adt_format.aria import device_from_camera
from egosplat_apartments.arrays import Array, Rng, Times, Trajectory
from egosplat_apartments.people.figure import STRIDE_M
from egosplat_apartments.people.jobs import REACHING_S, Errand, Job
from egosplat_apartments.people.smooth import STEP_S, SmoothTrack, control_times, limited
from egosplat_apartments.people.walk import Walk, make_route, make_walk
from egosplat_apartments.world.apartment import Apartment
from egosplat_apartments.world.floorplan import FloorPlan

_UPRIGHT_FROM_SENSOR = invert(CLOCKWISE)

EYES_M = 1.62
# Distance of the shoulders behind the camera.
SHOULDERS_BEHIND_M = 0.15
# Slowest and fastest walk, and the speed with an object in the hand.
_SPEEDS_M_S = (0.3, 0.55)
_CARRYING_M_S = 0.6
# Length of a walk around the room, which decides the speed in between.
_TOUR_M = 9.0
# Fastest turn and nod of the head [rad/s], and the range of its pitch [rad]: a head looks down more than up.
_TURN_PER_S, _NOD_PER_S = 1.2, 0.8
_PITCH_RANGE = (-0.95, 0.2)
# For how long a visitor is looked at, and for as long not, and at which height.
_WATCH_S, _CHEST_M = 2.5, 1.1
# The motion is defined this long before and after the recording.
_LEAD_S = 1.0


@dataclass(frozen=True)
class HeadMotion:
    """Position and orientation of the head over the recording.

    Attributes:
        walk: of the body; gaze: time [s] -> yaw, pitch [rad]; jobs: scheduled errands of the wearer.
    """

    walk: Walk
    gaze: SmoothTrack
    jobs: tuple[Job, ...]

    def world_from_upright(self, times: Array) -> Array:
        """(N, 4, 4) poses of the upright camera (OpenCV axes) at (N,) seconds."""
        x, z, heading, walked, crouch, lean = self.walk.track(times).T
        yaw, pitch = self.gaze(times).T
        # The head sways once and bobs twice per stride of two steps.
        step = 2 * np.pi * walked / STRIDE_M
        sway = 0.012 * np.sin(step)
        height = EYES_M - crouch + 0.012 * np.cos(2 * step)
        sine, cosine = np.sin(heading), np.cos(heading)
        place = np.stack([x + lean * sine - sway * cosine, height, z + lean * cosine + sway * sine], axis=-1)
        angles = np.stack([yaw, -(pitch + 0.006 * np.sin(2 * step)), 0.01 * np.sin(step)], axis=-1)
        head = Rotation.from_euler("YXZ", angles).as_matrix()
        # Head axes: x left, y up, z forward. Camera axes: x right, y down, z forward.
        return make_pose(head * [-1.0, -1.0, 1.0], place)

    def world_from_camera(self, times: Array) -> Array:
        """(N, 4, 4) poses of the camera, sensor orientation, at (N,) seconds."""
        return compose(self.world_from_upright(times), _UPRIGHT_FROM_SENSOR)

    def device_pose(self, start_ns: int) -> Trajectory:
        """(N,) int64 nanoseconds -> (N, 4, 4) ``world_from_device``; second 0 is at ``start_ns``."""
        upright_from_device = compose(_UPRIGHT_FROM_SENSOR, invert(device_from_camera()))

        def pose(times_ns: Times) -> Array:
            seconds = (np.asarray(times_ns, dtype=np.int64) - start_ns) * 1e-9
            return compose(self.world_from_upright(seconds), upright_from_device)

        return pose


def plan_head(apartment: Apartment, rng: Rng, seconds: float, errand: Errand | None) -> HeadMotion:
    """Plan a walk around the room, with one errand on the way."""
    speed = float(np.clip(_TOUR_M / seconds, *_SPEEDS_M_S))
    span = (-_LEAD_S, seconds + _LEAD_S)
    plan, needed = apartment.plan, speed * (span[1] - span[0]) + 1.0
    tour = tour_of(plan, rng)
    if errand is None:
        route = make_route(plan, long_enough(plan, tour, tour[0], needed, 1))
        walk = make_walk(route, np.array(span), np.array([0.3, 0.3 + speed * (span[1] - span[0])]), [], span)
        return looking_around(apartment, walk, [], rng, span)
    job = _schedule(errand, seconds)
    # An errand that outlasts the recording is still planned to its end.
    span = (-_LEAD_S, max(seconds, job.release_s + REACHING_S) + _LEAD_S)
    needed = speed * (span[1] - span[0]) + 1.0
    before = long_enough(plan, tour, errand.pick_stand, needed, -1)[::-1]
    after = long_enough(plan, tour, errand.put_stand, needed, 1)
    route = make_route(plan, [*before, *after])
    taken, put = route.stops[[len(before) - 1, len(before)]]
    arrive, leave = job.grip_s - REACHING_S, job.release_s + 0.8
    stops = [-_LEAD_S, arrive, job.grip_s + 0.5, job.release_s - 0.7, leave, span[1]]
    first, last = taken - speed * (arrive + _LEAD_S), put + speed * (span[1] - leave)
    along = [first, taken, taken, put, put, last]
    walk = make_walk(route, np.array(stops), np.array(along), [job], span, SHOULDERS_BEHIND_M)
    return looking_around(apartment, walk, [job], rng, span)


def looking_around(
    apartment: Apartment,
    walk: Walk,
    jobs: list[Job],
    rng: Rng,
    span: tuple[float, float],
    turn_per_s: float = _TURN_PER_S,
    visitor: Walk | None = None,
) -> HeadMotion:
    """Add the gaze from object to object, at the carried one around grip and release; the body turns with it.

    A visitor in the room is watched for half of the time.
    """
    grid, state = control_times(*span), walk.controls
    eyes = np.stack([state[:, 0], EYES_M - state[:, 4], state[:, 1]], axis=-1)
    targets = _fixations(apartment, grid, eyes, state[:, 2], rng)
    if visitor is not None:
        places = visitor.place(grid)
        inside = (np.abs(places) < np.array([apartment.room.width, apartment.room.depth]) / 2).all(axis=1)
        watched = inside & (grid % (2 * _WATCH_S) < _WATCH_S)
        targets[watched] = np.insert(places, 1, _CHEST_M, axis=1)[watched]
    for job in jobs:
        ends = (job.errand.thing.pose[:3, 3], job.errand.target[:3, 3])
        starts, stops = (job.grip_s - 1.6, job.release_s - 2.0), (job.grip_s + 0.5, job.release_s + 0.5)
        for end, first, last in zip(ends, starts, stops, strict=True):
            targets[(grid > first) & (grid < last)] = end
    way = targets - eyes
    yaw = np.arctan2(way[:, 0], way[:, 2])
    pitch = np.clip(np.arctan2(way[:, 1], np.hypot(way[:, 0], way[:, 2])), *_PITCH_RANGE)
    for job in jobs:
        carrying = (grid > job.grip_s) & (grid < job.release_s)
        pitch[carrying] = np.minimum(pitch[carrying], -0.4)
    yaw, pitch = limited(yaw, turn_per_s * STEP_S), limited(pitch, _NOD_PER_S * STEP_S)
    return HeadMotion(walk.facing(grid, yaw), SmoothTrack(grid, np.column_stack([yaw, pitch])), tuple(jobs))


def _schedule(errand: Errand, seconds: float) -> Job:
    """Schedule the errand somewhat before the middle of the recording."""
    # 0.5 s standing at the grip and 0.7 s before the release, see ``plan_head``.
    carrying = 1.2 + errand.walk_m / _CARRYING_M_S
    grip = max(0.9, 0.42 * seconds - carrying / 2)
    return Job(errand, grip, grip + carrying)


def tour_of(plan: FloorPlan, rng: Rng, stops: int = 6) -> list[Array]:
    """Places far from one another, in an order that goes around the room."""
    cells = np.argwhere(plan.inside & (plan.clearance > 0.33))
    places = plan.place(cells if len(cells) > stops else np.argwhere(plan.inside))
    chosen = [places[rng.integers(len(places))]]
    # Farthest-point sampling.
    while len(chosen) < stops:
        distance = np.min([np.linalg.norm(places - other, axis=1) for other in chosen], axis=0)
        chosen.append(places[distance.argmax()])
    middle = np.mean(chosen, axis=0)
    turn = 1 if rng.random() < 0.5 else -1
    return sorted(chosen, key=lambda place: turn * np.arctan2(*(place - middle)))


def long_enough(plan: FloorPlan, tour: list[Array], start: Array, needed_m: float, step: int) -> list[Array]:
    """Stops along the tour from a place, in one direction, until the route is long enough."""
    number = int(np.argmin([np.linalg.norm(place - start, axis=-1) for place in tour]))
    stops = [start]
    while _length(plan, stops) < needed_m:
        number += step
        stops.append(tour[number % len(tour)])
    return stops


def _length(plan: FloorPlan, stops: list[Array]) -> float:
    """Lower bound of the route's length: straight lines between the stops."""
    return float(sum(np.linalg.norm(b - a, axis=-1) for a, b in itertools.pairwise(stops)))


def _fixations(apartment: Apartment, grid: Array, eyes: Array, heading: Array, rng: Rng) -> Array:
    """(K, 3) gaze targets: objects ahead, not too near, none twice within a while."""
    centers = np.array([thing.bounds.mean(axis=0) for thing in apartment.things])
    seen_at = np.full(len(centers), -np.inf)
    targets, until, target = np.empty((len(grid), 3)), -np.inf, centers[0]
    for k, moment in enumerate(grid):
        if moment >= until:
            way = centers - eyes[k]
            distance = np.linalg.norm(way, axis=1)
            turn = np.arctan2(way[:, 0], way[:, 2]) - heading[k]
            off = np.abs((turn + np.pi) % (2 * np.pi) - np.pi)
            # Prefer objects ahead, near but not too near, and not fixated in the last seconds.
            cost = 0.45 * off + 0.6 * (distance < 0.9) + 0.1 * distance
            cost += 2.0 * np.exp((seen_at - moment) / 8.0)
            number = int(np.argmin(cost + rng.uniform(0, 0.7, len(cost))))
            target = centers[number]
            # Objects in the same direction count as seen too.
            along = (way * way[number]).sum(axis=1) / (distance * distance[number])
            seen_at[along > 0.9] = moment
            until = moment + rng.uniform(1.4, 2.4)
        targets[k] = target
    return targets

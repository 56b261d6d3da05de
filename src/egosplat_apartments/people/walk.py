"""A walk: places and headings over time, along routes that keep off the furniture."""

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from egosplat_apartments.arrays import Array
from egosplat_apartments.people.jobs import Job
from egosplat_apartments.people.smooth import STEP_S, SmoothTrack, control_times, limited
from egosplat_apartments.world.floorplan import FloorPlan

# Height of the shoulders and length of an arm.
_SHOULDER_M, _ARM_M = 1.38, 0.5
# Distance between two places of a route.
_SPACING_M = 0.03
# Fastest turn of the body [rad/s].
_TURN_PER_S = 2.2


@dataclass(frozen=True)
class Route:
    """A polyline through the room with even spacing.

    Attributes:
        places: (N, 2) x and z.
        stops: (S,) distance from the beginning to each of its stops [m].
    """

    places: Array
    stops: Array

    @property
    def length(self) -> float:
        """Length [m]."""
        return (len(self.places) - 1) * _SPACING_M

    def at(self, along: Array) -> Array:
        """(K, 2) places at distances from the beginning [m], clamped to the ends."""
        grid = np.arange(len(self.places)) * _SPACING_M
        return np.stack([np.interp(along, grid, self.places[:, axis]) for axis in (0, 1)], axis=-1)


def make_route(plan: FloorPlan, stops: list[Array]) -> Route:
    """A route through stops, with corners rounded as far as the furniture allows."""
    legs = [plan.route(a, b) for a, b in itertools.pairwise(stops)]
    line = np.concatenate([stops[0][None], *(leg[1:] for leg in legs)])
    steps = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    grid = np.arange(0.0, steps[-1] + _SPACING_M, _SPACING_M)
    even = np.stack([np.interp(grid, steps, line[:, axis]) for axis in (0, 1)], axis=-1)
    # Smooth as strongly as keeps 0.2 m from every obstacle.
    for blur_m in (0.22, 0.15, 0.1, 0.06):
        smooth = gaussian_filter1d(even, blur_m / _SPACING_M, axis=0, mode="nearest")
        if plan.clearance_at(smooth).min() > 0.2:
            break
    ends = np.cumsum([0, *(len(leg) - 1 for leg in legs)])
    return Route(smooth, steps[ends])


@dataclass(frozen=True)
class Walk:
    """A person's motion over time.

    Attributes:
        controls: (K, 6) control points of the track.
        track: time [s] -> x, z, heading [rad], distance walked [m], crouch and lean of the shoulders [m].
    """

    track: SmoothTrack
    controls: Array

    def facing(self, times: Array, headings: Array) -> "Walk":
        """Return this walk with other headings, given at the (K,) ``control_times``."""
        controls = self.controls.copy()
        controls[:, 2] = headings
        return Walk(SmoothTrack(times, controls), controls)

    def place(self, times: Array) -> Array:
        """(N, 2) x and z."""
        return self.track(times)[:, :2]


# A visitor's walk, and the jobs on the way.
Visit = tuple[Walk, tuple[Job, ...]]


def make_walk(
    route: Route,
    times: Array,
    along: Array,
    jobs: list[Job],
    duration: tuple[float, float],
    behind_m: float = 0.0,
) -> Walk:
    """Walk a route.

    Args:
        route: the way; times, along: (M,) times at which distances along it are reached, linear in between.
        jobs: errands on the way; the person turns to the object and bends for it.
        duration: first and last second of the walk.
        behind_m: distance of the shoulders behind the place that follows the route.
    """
    grid = control_times(*duration)
    where = np.interp(grid, times, along)
    # The person stands still before the first and after the last of ``times``.
    places = route.at(where)
    # The direction over half a meter: a single step of the route is too short to have a stable one.
    ahead = route.at(where + 0.25) - route.at(where - 0.25)
    heading = np.arctan2(ahead[:, 0], ahead[:, 1])
    crouch, lean = np.zeros(len(grid)), np.zeros(len(grid))
    for job in jobs:
        ends = (job.errand.thing.pose[:3, 3], job.errand.target[:3, 3])
        stands = (job.errand.pick_stand, job.errand.put_stand)
        for share, end, stand, moment in zip(
            job.bend(grid), ends, stands, (job.grip_s, job.release_s), strict=True
        ):
            distance = float(np.linalg.norm(end[[0, 2]] - stand, axis=-1)) + behind_m
            down, forward = _bend_for(distance, float(end[1]))
            crouch, lean = np.maximum(crouch, share * down), np.maximum(lean, share * forward)
            # The person faces the object while reaching for it.
            near = np.abs(grid - moment) < 0.9
            way = end[[0, 2]] - places[near]
            heading[near] = np.arctan2(way[:, 0], way[:, 1])
    heading = limited(heading, _TURN_PER_S * STEP_S)
    controls = np.column_stack([places, heading, where, crouch, lean])
    return Walk(SmoothTrack(grid, controls), controls)


def _bend_for(distance: float, height: float) -> tuple[float, float]:
    """Distances that the shoulders move down and forward [m] to reach an object."""
    forward = float(np.clip(distance - 0.3, 0, 0.45))
    left = distance - forward
    drop = np.sqrt(max(_ARM_M**2 - left**2, 0.01))
    return float(np.clip(_SHOULDER_M - (height + 0.05 + drop), 0, 0.7)), forward

"""Stage ``synthetic``: a synthetic apartment's recording, in ADT's on-disk format."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from egosplat_apartments.adt_format.adt import write_sequence
from egosplat_apartments.adt_format.points import semidense_points
from egosplat_apartments.adt_format.sequence import ROLLING_SHUTTER_MIDDLE_NS, Frame, Sequence
from egosplat_apartments.camera.drift import Drift, estimated_trajectory
from egosplat_apartments.camera.effects import IDEAL, Effects, make_effects
from egosplat_apartments.camera.filming import Film
from egosplat_apartments.camera.lens import Lens, make_lens
from egosplat_apartments.camera.lighting import make_lights
from egosplat_apartments.camera.render import Renderer
from egosplat_apartments.options import SyntheticOptions
from egosplat_apartments.world.world import World, make_world


def run(output: Path, options: SyntheticOptions) -> None:
    """Write the recording's folder at ``output``."""
    world = {
        name: getattr(options, name)
        for name in ("seed", "size", "fps", "seconds", "objects", "motion", "world", "walk")
    }
    effects = make_effects(options)
    sequence = make_sequence(name=f"synthetic_apartment_seed{options.seed}", **world, effects=effects)
    write_sequence(sequence, output, jpeg_quality=effects.jpeg_quality)


_MARGIN_NS = 200_000_000
# What the frames say of themselves: the exposure time of an instant, and the gain of a middle exposure.
_EXPOSURE_S, _GAIN = 0.0045, 2.0


def make_sequence(
    *,
    name: str,
    seed: int,
    size: int,
    fps: float,
    seconds: float,
    objects: int = 24,
    motion: float = 0.5,
    world: str = "usual",
    walk: int = 0,
    effects: Effects = IDEAL,
) -> Sequence:
    """Make a recording of a furnished apartment.

    Args:
        seed: of the apartment; walk: number of the walk through it. Both determine the recording, bit by bit.
        size: side of the square image [px]; fps: frames per second; seconds: length.
        objects: number of labeled objects, 16 to 40.
        motion: fraction 0..1 of the time in which people are at work.
            Carrying one object takes some seconds, so a short recording may have a larger fraction.
        world: ``usual``, ``busy`` or ``foreign``.
        effects: of the camera; their JPEG quality is for ``write_sequence``.

    Raises:
        UserError: the objects do not fit.
        ValueError: ``motion`` is out of range.
    """
    made = make_world(seed=seed, seconds=seconds, objects=objects, motion=motion, world=world, walk=walk)
    renderer = make_renderer(made, make_lens(size))
    return record_world(made, renderer, name=name, fps=fps, seconds=seconds, effects=effects)


def record_world(
    world: World, renderer: Renderer, *, name: str, fps: float, seconds: float, effects: Effects = IDEAL
) -> Sequence:
    """Record a world; see ``make_sequence``."""
    count = max(1, round(seconds * fps))
    captures = world.start_ns + np.round(np.arange(count) * 1e9 / fps).astype(np.int64)
    device_pose = world.head.device_pose(world.start_ns)
    span = (int(captures[0]) - _MARGIN_NS, int(captures[-1]) + _MARGIN_NS)
    drift = Drift(effects, world.seed, *span)
    points, inv_dist_std, dist_std = semidense_points(
        world, renderer, captures, np.random.default_rng([world.seed, 5]), drift if effects.drifts else None
    )
    poses = [np.eye(4), *(thing.pose for thing in world.apartment.things)]
    things = zip(world.apartment.instances, poses, strict=True)
    return Sequence(
        name=name,
        size=renderer.lens.size,
        fps=fps,
        instances=world.instances,
        world_from_static={one.instance_id: pose for one, pose in things if one.motion_type == "static"},
        device_pose=device_pose,
        start_ns=span[0],
        end_ns=span[1],
        points=points,
        inv_dist_std=inv_dist_std,
        dist_std=dist_std,
        frames=lambda: render_frames(world, renderer, captures, effects),
        frame_count=count,
        wearer=world.people[0].instance.instance_id if world.people else None,
        estimated_pose=estimated_trajectory(device_pose, effects, drift, *span),
        # The usual recordings keep their files.
        rests=() if world.kind == "usual" else world.rests(seconds),
    )


def make_renderer(world: World, lens: Lens) -> Renderer:
    """A renderer of the world's surfaces and light through a lens."""
    lights = make_lights(world.apartment.room, np.random.default_rng([world.seed, 3]))
    return Renderer(world.geometry, lights, lens, np.random.default_rng([world.seed, 4]))


def render_frames(
    world: World, renderer: Renderer, captures: NDArray[np.int64], effects: Effects
) -> Iterator[Frame]:
    """Yield the frames captured at (F,) nanoseconds, in order; several are rendered at a time."""
    seconds = (captures + ROLLING_SHUTTER_MIDDLE_NS - world.start_ns) * 1e-9
    film = Film(world, renderer, seconds, effects)

    def frame(number: int) -> Frame:
        moment, exposure = float(seconds[number]), film.exposures[number]
        moved = world.moved_things(moment)
        return Frame(
            int(captures[number]),
            exposure.open_s or _EXPOSURE_S,
            _GAIN * exposure.gain,
            *film.shoot(number),
            world_from_object=world.thing_poses(moment),
            skeletons={person.instance.instance_id: person.joints(moment, moved) for person in world.people},
        )

    return in_order(frame, range(len(captures)))


Item = TypeVar("Item")
Result = TypeVar("Result")


def in_order(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Yield ``function(item)`` of each item, computed in as many threads as the job has.

    At most one result per thread waits to be taken, so that memory does not grow with the number of items.
    """
    workers = threads()
    pending: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(workers) as pool:
        try:
            for item in items:
                pending.append(pool.submit(function, item))
                if len(pending) > workers:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            # After an error, or if no more results are taken, what has not begun is not computed.
            for waiting in pending:
                waiting.cancel()


def threads() -> int:
    """Threads of this job: OMP_NUM_THREADS, which Snakemake sets, or all processors that it may use."""
    given = os.environ.get("OMP_NUM_THREADS", "")
    return max(1, int(given)) if given.isdecimal() else len(os.sched_getaffinity(0))

"""Stage ``synthetic``: a synthetic apartment's recording, in ADT's on-disk format."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.synthetic.adt_format.adt import write_sequence
from egosplat.synthetic.adt_format.points import semidense_points
from egosplat.synthetic.adt_format.sequence import ROLLING_SHUTTER_MIDDLE_NS, Frame, Sequence
from egosplat.synthetic.camera.lens import Lens, make_lens
from egosplat.synthetic.camera.lighting import make_lights
from egosplat.synthetic.camera.render import Renderer
from egosplat.synthetic.world.world import World, camera_pose, make_world


@dataclass(frozen=True)
class SyntheticOptions:
    """The schema's keys of ``synthetic``; ``config.schema.yaml`` describes each."""

    seed: int
    size: int
    fps: float
    seconds: float
    objects: int
    motion: float


def run(output: Path, options: SyntheticOptions) -> None:
    """Write the recording's folder at ``output``."""
    sequence = make_sequence(name=f"synthetic_apartment_seed{options.seed}", **asdict(options))
    write_sequence(sequence, output)


_MARGIN_NS = 200_000_000
_EXPOSURE_S = 0.0045


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
    """Make a recording of a furnished apartment.

    Args:
        seed: determines apartment and walk; the same seed gives the same recording, bit by bit.
        size: side of the square image [px]; fps: frames per second; seconds: length.
        objects: number of labelled objects, 16 to 40.
        motion: ``none``, ``low``, ``high``, or the fraction 0..1 of the time in which people are at work.
            Carrying one object takes some seconds, so a short recording may have a larger fraction.

    Raises:
        UserError: the objects do not fit.
        ValueError: ``motion`` is out of range.
    """
    world = make_world(seed=seed, seconds=seconds, objects=objects, motion=motion)
    return record_world(world, make_renderer(world, make_lens(size)), name=name, fps=fps, seconds=seconds)


def record_world(world: World, renderer: Renderer, *, name: str, fps: float, seconds: float) -> Sequence:
    """Record a world; see ``make_sequence``."""
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
        wearer=world.people[0].instance.instance_id if world.people else None,
    )


def make_renderer(world: World, lens: Lens) -> Renderer:
    """A renderer of the world's surfaces and light through a lens."""
    lights = make_lights(world.apartment.room, np.random.default_rng([world.seed, 3]))
    return Renderer(world.geometry, lights, lens, np.random.default_rng([world.seed, 4]))


def render_frames(world: World, renderer: Renderer, captures: NDArray[np.int64]) -> Iterator[Frame]:
    """Yield the frames captured at (F,) nanoseconds."""
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

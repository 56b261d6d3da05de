"""Fixtures: one furnished apartment with a recording of people at work in it, and a smaller world."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass

import pytest

from egosplat_apartments.adt_format.sequence import Frame, Sequence
from egosplat_apartments.camera.lens import make_lens
from egosplat_apartments.camera.render import Renderer
from egosplat_apartments.stage import make_renderer, record_world
from egosplat_apartments.world.apartment import Apartment
from egosplat_apartments.world.world import World, make_world

SIZE, FPS, SECONDS, OBJECTS = 192, 2.5, 16.0, 24


@dataclass(frozen=True)
class Recorded:
    """A recording with the world and the renderer that it was made from."""

    world: World
    renderer: Renderer
    sequence: Sequence
    frames: list[Frame]


@pytest.fixture(scope="session")
def recorded() -> Recorded:
    world = make_world(seed=5, seconds=SECONDS, objects=OBJECTS, motion=0.6)
    renderer = make_renderer(world, make_lens(SIZE))
    sequence = record_world(world, renderer, name="busy", fps=FPS, seconds=SECONDS)
    return Recorded(world, renderer, sequence, list(sequence.frames()))


@pytest.fixture(scope="session")
def apartment(recorded: Recorded) -> Apartment:
    return recorded.world.apartment


SMALL_WORLD = {"seed": 8, "seconds": 3.0, "objects": 16, "motion": 0.5}


@pytest.fixture(scope="session")
def small_world() -> World:
    """With as few objects as there can be."""
    return make_world(**SMALL_WORLD)


def digest_of(sequence: Sequence, frames: Iterable[Frame]) -> "hashlib._Hash":
    """The digest of points and frames. With AVX-512 the wearer's way differs in the last bit on some processors."""
    digest = hashlib.sha256(sequence.points.round(9).tobytes())
    for frame in frames:
        digest.update(frame.rgb.tobytes())
        for view in (frame.with_people, frame.without_people):
            digest.update(view.segmentation.tobytes() + view.depth_mm.tobytes())
    return digest

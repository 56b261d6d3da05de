"""Fixtures: one furnished apartment, and one recording of it with people at work."""

from dataclasses import dataclass

import numpy as np
import pytest

from egosplat_apartments.adt_format.sequence import Frame, Sequence
from egosplat_apartments.camera.lens import make_lens
from egosplat_apartments.camera.render import Renderer
from egosplat_apartments.stage import make_renderer, record_world
from egosplat_apartments.world.apartment import Apartment, make_apartment
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
def apartment() -> Apartment:
    return make_apartment(np.random.default_rng(11), OBJECTS)


@pytest.fixture(scope="session")
def recorded() -> Recorded:
    world = make_world(seed=5, seconds=SECONDS, objects=OBJECTS, motion=0.6)
    renderer = make_renderer(world, make_lens(SIZE))
    sequence = record_world(world, renderer, name="busy", fps=FPS, seconds=SECONDS)
    return Recorded(world, renderer, sequence, list(sequence.frames()))

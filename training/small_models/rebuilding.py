"""The surfaces of a world that was filmed before, made again from its seed."""

import json
from pathlib import Path

import numpy as np

from egosplat.synthetic.world.world import World
from training.small_models.levels import Levels, find_levels
from training.small_models.worlds import Filming, make_furnished_world


def rebuild_world(folder: Path) -> tuple[World, Levels]:
    """The world that ``film_world`` has filmed into a folder.

    Raises:
        ValueError: the world made now is not the one that was filmed.
    """
    about = json.loads((folder / "world.json").read_text())
    filming = Filming(**about["filming"])
    spacing_s = filming.frames * filming.step_s + 2.0
    world = make_furnished_world(
        about["seed"], np.random.default_rng([about["seed"], 100]), spacing_s * filming.clips
    )
    levels = find_levels(world)
    if list(levels.part_names) != about["part_names"]:
        raise ValueError(f"{folder}: seed {about['seed']} does not make the same parts any more")
    return world, levels

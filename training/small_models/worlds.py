"""Worlds for training: apartments by seed, rendered as short clips with the subpart of every pixel."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.files import atomic_directory
from egosplat.frames.rectify import pinhole
from egosplat.geometry import CLOCKWISE
from egosplat_apartments.camera.lens import pinhole_lens
from egosplat_apartments.stage import make_renderer
from egosplat_apartments.world.world import World, camera_pose, make_world
from training.small_models.homes import home_gain, home_renderer
from training.small_models.levels import Levels, find_levels

# The subpart of pixels outside the lens circle.
NOTHING = np.uint16(2**16 - 1)

# First seeds of the worlds; recordings and tests use far smaller ones.
TRAINING_SEEDS, HELD_OUT_SEEDS = 1_000_000, 2_000_000


@dataclass(frozen=True)
class ClipSettings:
    """Settings of the rendering of a world.

    Attributes:
        size: side of the square, upright pinhole image [px].
        clips: number of clips; frames: per clip; step_s: time between frames [s].
        homes: whether surfaces and light are those of ``homes``.
    """

    size: int = 384
    clips: int = 4
    frames: int = 6
    step_s: float = 0.25
    homes: bool = False

    @property
    def spacing_s(self) -> float:
        """Time between the starts of clips [s]."""
        return self.frames * self.step_s + 2.0

    @property
    def seconds(self) -> float:
        """Length of the recording that all clips need [s]."""
        return self.spacing_s * self.clips


def render_world(seed: int, settings: ClipSettings, folder: Path) -> None:
    """Render the world of a seed into a folder: ``rgb.npy``, ``subpart.npy`` and ``world.json``."""
    rng = np.random.default_rng([seed, 100])
    world = make_furnished_world(seed, rng, settings.seconds)
    levels = find_levels(world)
    lens, looks = pinhole_lens(pinhole(settings.size)), np.random.default_rng([seed, 101])
    renderer = home_renderer(world, lens, looks) if settings.homes else make_renderer(world, lens)
    starts = settings.spacing_s * np.arange(settings.clips) + rng.uniform(0, 2.0, settings.clips)
    moments = (starts[:, None] + settings.step_s * np.arange(settings.frames)).ravel()
    shape = (settings.clips, settings.frames, settings.size, settings.size)
    rgb, subpart = [], []
    for seconds in moments:
        pose = camera_pose(world, seconds) @ CLOCKWISE
        gain = float(rng.uniform(0.85, 1.2))
        bodies = world.body_poses(seconds)
        if settings.homes:
            gain = home_gain(renderer.brightness(pose, bodies), looks)
        picture, faces = renderer.picture(pose, bodies, gain, rng)
        rgb.append(picture)
        subpart.append(np.where(faces >= 0, levels.face_subpart[faces], NOTHING))
    with atomic_directory(folder) as made:
        np.save(made / "rgb.npy", np.stack(rgb).reshape(*shape, 3))
        np.save(made / "subpart.npy", np.stack(subpart).astype(np.uint16).reshape(shape))
        (made / "world.json").write_text(json.dumps(_tables(seed, settings, world, levels)))


def rebuild_world(folder: Path) -> tuple[World, Levels]:
    """Rebuild the world that ``render_world`` rendered into a folder.

    Raises:
        ValueError: the rebuilt world is not the rendered one.
    """
    about = json.loads((folder / "world.json").read_text())
    seed, settings = about["seed"], ClipSettings(**about["filming"])
    world = make_furnished_world(seed, np.random.default_rng([seed, 100]), settings.seconds)
    levels = find_levels(world)
    if list(levels.part_names) != about["part_names"]:
        raise ValueError(f"{folder}: seed {seed} does not make the same parts any more")
    return world, levels


def make_furnished_world(seed: int, rng: np.random.Generator, seconds: float) -> World:
    """Make an apartment; the number of objects is redrawn until they fit."""
    for objects in rng.permutation(np.arange(18, 39)):
        try:
            return make_world(
                seed=seed, seconds=seconds, objects=int(objects), motion=float(rng.uniform(0.3, 1))
            )
        except UserError:
            continue
    raise UserError(f"seed {seed}: no number of objects fits")


def _tables(seed: int, settings: ClipSettings, world: World, levels: Levels) -> dict[str, object]:
    return {
        "seed": seed,
        "filming": vars(settings),
        "subpart_part": levels.subpart_part.tolist(),
        "part_whole": levels.part_whole.tolist(),
        "part_names": levels.part_names,
        "whole_names": levels.whole_names,
        "whole_instance": levels.whole_instance.tolist(),
        "motion_types": [one.motion_type for one in world.instances],
    }


@dataclass(frozen=True, eq=False)
class RenderedWorld:
    """A rendered world; images are memory-mapped.

    Attributes:
        rgb: (C, T, S, S, 3) uint8; subpart: (C, T, S, S) uint16.
        tables: (3, P + 1) int32: subpart, part and whole of each subpart; the last column is -1, for pixels
            that show nothing.
        names: of the wholes; part_names: of the parts, numbered across all wholes.
    """

    rgb: NDArray[np.uint8]
    subpart: NDArray[np.uint16]
    tables: NDArray[np.int32]
    names: tuple[str, ...]
    part_names: tuple[str, ...]

    def labels(self, subpart: NDArray[np.uint16]) -> NDArray[np.int32]:
        """(...,) subparts -> (3, ...) numbers of subpart, part and whole; -1 for none."""
        return self.tables[:, np.minimum(subpart, self.tables.shape[1] - 1)]


def read_world(folder: Path) -> RenderedWorld:
    """Read the world that ``render_world`` wrote."""
    about = json.loads((folder / "world.json").read_text())
    subpart_part, part_whole = (np.array(about[name]) for name in ("subpart_part", "part_whole"))
    tables = np.stack([np.arange(len(subpart_part)), subpart_part, part_whole[subpart_part]])
    return RenderedWorld(
        np.load(folder / "rgb.npy", mmap_mode="r"),
        np.load(folder / "subpart.npy", mmap_mode="r"),
        np.pad(tables, ((0, 0), (0, 1)), constant_values=-1).astype(np.int32),
        tuple(about["whole_names"]),
        tuple(about["part_names"]),
    )

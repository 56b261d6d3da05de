"""Worlds to learn from: apartments by seed, filmed in short clips, with the subpart that every pixel shows."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from egosplat.files import atomic_directory
from egosplat.frames.rectify import pinhole
from egosplat.geometry import CLOCKWISE
from egosplat.synthetic.camera.lens import pinhole_lens
from egosplat.synthetic.recording import make_renderer
from egosplat.synthetic.world.world import World, camera_pose, make_world
from training.small_models.levels import Levels, find_levels

FOCAL = 460.0
"""The paper's focal length of rectified pictures, at a side of 1408 px."""

NOTHING = np.uint16(2**16 - 1)
"""The subpart of pixels outside of the lens circle."""

TRAINING_SEEDS, HELD_OUT_SEEDS = 1_000_000, 2_000_000
"""Where the seeds of worlds begin; those of recordings and tests are far below."""


@dataclass(frozen=True)
class Filming:
    """How a world is filmed.

    Attributes:
        size: side of the square, upright pinhole picture [px].
        clips: how many; frames: of each; step_s: time between frames [s].
    """

    size: int = 384
    clips: int = 4
    frames: int = 6
    step_s: float = 0.25


def film_world(seed: int, filming: Filming, folder: Path) -> None:
    """Render the world of a seed into a folder: ``rgb.npy``, ``subpart.npy`` and ``world.json``."""
    rng = np.random.default_rng([seed, 100])
    spacing_s = filming.frames * filming.step_s + 2.0
    world = make_furnished_world(seed, rng, spacing_s * filming.clips)
    levels = find_levels(world)
    renderer = make_renderer(world, pinhole_lens(pinhole(filming.size, FOCAL)))
    starts = spacing_s * np.arange(filming.clips) + rng.uniform(0, 2.0, filming.clips)
    moments = (starts[:, None] + filming.step_s * np.arange(filming.frames)).ravel()
    shape = (filming.clips, filming.frames, filming.size, filming.size)
    rgb, subpart = [], []
    for seconds in moments:
        pose = camera_pose(world, seconds) @ CLOCKWISE
        gain = float(rng.uniform(0.85, 1.2))
        picture = renderer.picture(pose, world.body_poses(seconds), gain, rng)
        rgb.append(picture.rgb)
        subpart.append(np.where(picture.faces >= 0, levels.face_subpart[picture.faces], NOTHING))
    with atomic_directory(folder) as made:
        np.save(made / "rgb.npy", np.stack(rgb).reshape(*shape, 3))
        np.save(made / "subpart.npy", np.stack(subpart).astype(np.uint16).reshape(shape))
        (made / "world.json").write_text(json.dumps(_tables(seed, filming, world, levels)))


def make_furnished_world(seed: int, rng: np.random.Generator, seconds: float) -> World:
    """An apartment of which not every number of objects finds its place."""
    for objects in rng.permutation(np.arange(18, 39)):
        try:
            return make_world(
                seed=seed, seconds=seconds, objects=int(objects), motion=float(rng.uniform(0.3, 1))
            )
        except UserError:
            continue
    raise UserError(f"no apartment can be made of seed {seed}")


def _tables(seed: int, filming: Filming, world: World, levels: Levels) -> dict[str, object]:
    return {
        "seed": seed,
        "filming": vars(filming),
        "subpart_part": levels.subpart_part.tolist(),
        "part_whole": levels.part_whole.tolist(),
        "part_names": levels.part_names,
        "whole_names": levels.whole_names,
        "whole_instance": levels.whole_instance.tolist(),
        "motion_types": [one.motion_type for one in world.instances],
    }


@dataclass(frozen=True, eq=False)
class FilmedWorld:
    """A world read back; pictures are mapped, not loaded.

    Attributes:
        rgb: (C, T, S, S, 3) uint8; subpart: (C, T, S, S) uint16.
        tables: (3, P + 1) int32: what each subpart is at the levels subpart, part and whole; the last column,
            for pixels that show nothing, is -1.
        names: of the wholes; part_names: of the parts, which are numbered through all wholes.
    """

    rgb: NDArray[np.uint8]
    subpart: NDArray[np.uint16]
    tables: NDArray[np.int32]
    names: tuple[str, ...]
    part_names: tuple[str, ...]

    def labels(self, subpart: NDArray[np.uint16]) -> NDArray[np.int32]:
        """(...,) subparts -> (3, ...) numbers of subpart, part and whole; -1 for nothing."""
        return self.tables[:, np.minimum(subpart, self.tables.shape[1] - 1)]


def read_world(folder: Path) -> FilmedWorld:
    """What ``film_world`` wrote."""
    about = json.loads((folder / "world.json").read_text())
    subpart_part, part_whole = (np.array(about[name]) for name in ("subpart_part", "part_whole"))
    tables = np.stack([np.arange(len(subpart_part)), subpart_part, part_whole[subpart_part]])
    return FilmedWorld(
        np.load(folder / "rgb.npy", mmap_mode="r"),
        np.load(folder / "subpart.npy", mmap_mode="r"),
        np.pad(tables, ((0, 0), (0, 1)), constant_values=-1).astype(np.int32),
        tuple(about["whole_names"]),
        tuple(about["part_names"]),
    )

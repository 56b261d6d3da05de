"""Held-out worlds as cases to measure on: points with what they mean, all instances, masks to follow."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from training.small_models.levels import LEVELS
from training.small_models.worlds import NOTHING, FilmedWorld, read_world

SIZES = {"< 0.1 %": 0.0, "0.1-1 %": 0.001, "1-5 %": 0.01, "> 5 %": 0.05}
"""Classes of size by the share of the picture that a mask covers: from here to the next one."""

LEAST_PIXELS = 40
_POINTS_A_LEVEL = 12

Masks = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Picture:
    """One still with the truth about some points.

    Attributes:
        rgb: (H, W, 3) uint8; valid: (H, W) bool.
        points: (K, 2) pixel (x, y) of a random place inside a mask; masks: (K, H, W) bool; levels: (K,) of each.
        wholes: (M, H, W) bool: every thing, person and piece of the building of at least 40 pixels.
    """

    rgb: NDArray[np.uint8]
    valid: Masks
    points: NDArray[np.float64]
    masks: Masks
    levels: NDArray[np.int64]
    wholes: Masks


@dataclass(frozen=True, eq=False)
class Film:
    """One clip and the masks to follow through it.

    Attributes:
        rgb: (T, H, W, 3) uint8; valid: (H, W) bool.
        masks: (K, T, H, W) bool; all are visible in the first frame.
    """

    rgb: NDArray[np.uint8]
    valid: Masks
    masks: Masks


def read_worlds(folder: Path) -> list[FilmedWorld]:
    """All worlds in a folder. Raises as ``world_folders`` does."""
    return [read_world(each) for each in world_folders(folder)]


def world_folders(folder: Path) -> list[Path]:
    """The folders of all worlds in a folder.

    Raises:
        UserError: there are none.
    """
    worlds = sorted(folder.glob("[0-9]*"))
    if not worlds:
        raise UserError(
            f"{folder}: holds no worlds; run python -m training.render_worlds {folder} --worlds 20 --held-out "
            "--size 512 --clips 1 --frames 48 --step 0.2"
        )
    return worlds


def pictures(world: FilmedWorld, every: int, rng: np.random.Generator) -> Iterator[Picture]:
    """Every so many frames of the first clip."""
    for frame in range(0, world.rgb.shape[1], every):
        labels = world.labels(world.subpart[0, frame])
        points, masks, levels = [], [], []
        for level in range(len(LEVELS)):
            for value in _chosen(labels[level], rng):
                mask = labels[level] == value
                rows, columns = np.nonzero(mask)
                place = rng.integers(len(rows))
                points.append((columns[place] + 0.5, rows[place] + 0.5))
                masks.append(mask)
                levels.append(level)
        wholes = np.stack([labels[2] == value for value in _large(labels[2])])
        yield Picture(
            np.asarray(world.rgb[0, frame]),
            labels[0] >= 0,
            np.array(points),
            np.stack(masks),
            np.array(levels),
            wholes,
        )


def _large(labels: NDArray[np.int32]) -> NDArray[np.int32]:
    values, areas = np.unique(labels, return_counts=True)
    return values[(values >= 0) & (areas >= LEAST_PIXELS)]


def _chosen(labels: NDArray[np.int32], rng: np.random.Generator) -> NDArray[np.int32]:
    return rng.permutation(_large(labels))[:_POINTS_A_LEVEL]


def film(world: FilmedWorld, count: int, rng: np.random.Generator) -> Film:
    """The first clip with wholes to follow: first those that are hidden for a while and come back, then others."""
    labels = world.labels(world.subpart[0])[2]
    first, areas = np.unique(labels[0], return_counts=True)
    values = first[(first >= 0) & (areas >= 0.002 * labels[0].size)]
    visible = np.stack([(labels == value).sum(axis=(1, 2)) >= LEAST_PIXELS for value in values])
    order = sorted(range(len(values)), key=lambda k: (not comes_back(visible[k]), rng.random()))
    masks = np.stack([labels == values[k] for k in order[:count]])
    return Film(np.asarray(world.rgb[0]), world.subpart[0, 0] != NOTHING, masks)


def comes_back(visible: NDArray[np.bool_]) -> bool:
    """Whether (T,) visibility ends and begins again."""
    changes = np.diff(visible.astype(np.int8))
    gone = np.flatnonzero(changes < 0)
    return bool(len(gone) and (changes[gone[0] :] > 0).any())


def size_class(mask: Masks) -> str:
    """The name in ``SIZES`` for a mask."""
    return [name for name, least in SIZES.items() if mask.mean() >= least][-1]

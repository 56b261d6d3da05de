"""Held-out worlds as test cases: points with their true masks, and masks to track."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.errors import UserError
from training.small_models.levels import LEVELS
from training.small_models.worlds import NOTHING, RenderedWorld

# Classes of masks by the least share of the frame that they cover.
SIZES = {"< 0.1 %": 0.0, "0.1-1 %": 0.001, "1-5 %": 0.01, "> 5 %": 0.05}

LEAST_PIXELS = 40
_POINTS_PER_LEVEL = 12

Masks = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Still:
    """One frame with the truth about some points.

    Attributes:
        rgb: (H, W, 3) uint8; valid: (H, W) bool.
        points: (K, 2) pixel (x, y) of a random place inside a mask; masks: (K, H, W) bool; levels: (K,) of each.
    """

    rgb: NDArray[np.uint8]
    valid: Masks
    points: NDArray[np.float64]
    masks: Masks
    levels: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Film:
    """One clip and the masks to track through it.

    Attributes:
        rgb: (T, H, W, 3) uint8; valid: (H, W) bool.
        masks: (K, T, H, W) bool; all are visible in the first frame.
    """

    rgb: NDArray[np.uint8]
    valid: Masks
    masks: Masks


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


def stills(world: RenderedWorld, every: int, rng: np.random.Generator) -> Iterator[Still]:
    """Every ``every``-th frame of the first clip, with up to 12 points at each level."""
    for frame in range(0, world.rgb.shape[1], every):
        labels = world.labels(world.subpart[0, frame])
        points, masks, levels = [], [], []
        for level in range(len(LEVELS)):
            values, areas = np.unique(labels[level], return_counts=True)
            large = values[(values >= 0) & (areas >= LEAST_PIXELS)]
            for value in rng.permutation(large)[:_POINTS_PER_LEVEL]:
                mask = labels[level] == value
                rows, columns = np.nonzero(mask)
                place = rng.integers(len(rows))
                points.append((columns[place] + 0.5, rows[place] + 0.5))
                masks.append(mask)
                levels.append(level)
        rgb = np.asarray(world.rgb[0, frame])
        yield Still(rgb, labels[0] >= 0, np.array(points), np.stack(masks), np.array(levels))


def film(world: RenderedWorld, count: int, rng: np.random.Generator) -> Film:
    """The first clip with ``count`` wholes to track, those first that disappear and come back."""
    labels = world.labels(world.subpart[0])[2]
    first, areas = np.unique(labels[0], return_counts=True)
    values = first[(first >= 0) & (areas >= 0.002 * labels[0].size)]
    visible = np.stack([(labels == value).sum(axis=(1, 2)) >= LEAST_PIXELS for value in values])
    order = sorted(range(len(values)), key=lambda k: (not comes_back(visible[k]), rng.random()))
    masks = np.stack([labels == values[k] for k in order[:count]])
    return Film(np.asarray(world.rgb[0]), world.subpart[0, 0] != NOTHING, masks)


def comes_back(visible: NDArray[np.bool_]) -> bool:
    """Whether (T,) visibility ends and starts again."""
    changes = np.diff(visible.astype(np.int8))
    gone = np.flatnonzero(changes < 0)
    return bool(len(gone) and (changes[gone[0] :] > 0).any())


def size_class(mask: Masks) -> str:
    """The name in ``SIZES`` of a mask."""
    return [name for name, least in SIZES.items() if mask.mean() >= least][-1]

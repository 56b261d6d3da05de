"""Where GAGS prompts SAM in a view (Peng et al. 2024): more points where a surface is seen from farther than elsewhere.

SAM's masks are finer where a thing is larger in the image. Points denser by the distance make up for it.
"""

import numpy as np
from numpy.typing import NDArray

# Published: cells a side of an image, and parts a side of a cell.
CELLS, PARTS = 8, 10

# Published: points a side of a cell for a ratio of 1, and their maximum.
_DENSITY, _MOST = 4, 20

# Ratios this much below a limit reach it: at a wall seen from straight ahead, rounding would decide.
_ROUNDING = 1e-4


def cell_ratios(depth: NDArray[np.float64], least: NDArray[np.float64]) -> NDArray[np.float64]:
    """How many times as far as in the nearest view each cell of a view is.

    Args:
        depth: (H, W) camera z of the surfaces [m]; 0 without one.
        least: (H, W) least depth of the Gaussian whose center a pixel holds, over all views that see it [m]; 0 without one.

    Returns:
        (CELLS, CELLS) mean depth over mean least depth, each over the pixels that have one; NaN where none has.
    """
    cell = _squares(depth.shape, CELLS)
    with np.errstate(invalid="ignore"):  # 0 / 0: a cell without a surface, or without a center
        means = [
            np.bincount(cell.ravel(), values.ravel(), CELLS**2)
            / np.bincount(cell.ravel(), (values > 0).ravel(), CELLS**2)
            for values in (depth, least)
        ]
        return (means[0] / means[1]).reshape(CELLS, CELLS)


def points_a_side(ratios: NDArray[np.float64]) -> NDArray[np.int64]:
    """Side of the square number of points in a cell: 4 times its ratio, 1 to 20; 1 for a ratio below 1 or NaN."""
    reached = np.nan_to_num(ratios) + _ROUNDING
    return np.where(reached < 1, 1, np.clip(_DENSITY * reached, 1, _MOST)).astype(np.int64)


def draw_points(
    sides: NDArray[np.int64], centers: NDArray[np.bool_], random: np.random.Generator
) -> NDArray[np.float32]:
    """Draw points in each cell of a view, more in the parts of a cell that hold more centers.

    Args:
        sides: (CELLS, CELLS) side of the square number of points.
        centers: (H, W) pixels that hold the center of a Gaussian in view.

    Returns:
        (P, 2) x, y in [0, 1], cell by cell.
    """
    side = CELLS * PARTS
    held = np.bincount(_squares(centers.shape, side)[centers], minlength=side**2)
    parts = held.reshape(CELLS, PARTS, CELLS, PARTS).swapaxes(1, 2).reshape(CELLS**2, PARTS**2)
    # 1 more: a part without a center is drawn, too.
    chances = (parts + 1) / (parts + 1).sum(axis=1, keepdims=True)
    points = []
    for cell, count in enumerate(sides.ravel() ** 2):
        row, column = np.divmod(random.choice(PARTS**2, count, p=chances[cell]), PARTS)
        corner = np.stack([column + cell % CELLS * PARTS, row + cell // CELLS * PARTS], axis=1)
        points.append((corner + random.random((count, 2))) / side)
    return np.concatenate(points).astype(np.float32)


def _squares(shape: tuple[int, ...], side: int) -> NDArray[np.int64]:
    """(H, W) number of the square of each pixel, where ``side`` times ``side`` of them cover the image, row by row."""
    rows, columns = (np.arange(size) * side // size for size in shape)
    return rows[:, None] * side + columns

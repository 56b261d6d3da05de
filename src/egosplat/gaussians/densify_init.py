"""Points where a photograph shows something and none is known: windows, plain walls, lamps.

Trackers find points at corners alone. Where none are, Gaussians grow slowly, and what is not learnt yet looks as if it
moved.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from egosplat.gaussians.initialization import Points
from egosplat.geometry import Camera, invert, transform

Colours = NDArray[np.uint8]

CELLS = 48
"""Cells along the longer side of a photograph; each is to show a point."""

_LEAST_CELL = 2.0
"""Side of a cell [px], at least."""


def covered(
    xyz: Points,
    rgb: Colours,
    camera: Camera,
    camera_to_world: Points,
    pictures: Iterable[NDArray[np.uint8]],
    valid: NDArray[np.bool_],
    *,
    near_plane: float,
) -> tuple[Points, Colours]:
    """Points with more of them, so that each cell of each photograph shows one.

    A new one lies in the middle of its cell, as far away as the median point of the nearest cell that shows points, and
    has the photograph's colour there. Those of one photograph count for the next. Nothing is added to a photograph that
    shows no point at all.

    Args:
        xyz: (P, 3) float64, finite, in the world [m].
        rgb: (P, 3) uint8.
        camera: of all photographs.
        camera_to_world: (V, 4, 4) float64.
        pictures: V of (H, W, 3) uint8, looked at one by one.
        valid: (H, W) bool; other pixels show nothing.
        near_plane: least camera z [m].

    Returns:
        (P + N, 3) float64 and (P + N, 3) uint8: the given ones, then the new ones.
    """
    middles = _middles(camera)
    columns, rows = middles.astype(np.int64).transpose(2, 0, 1)
    shows = valid[rows, columns]
    for pose, picture in zip(camera_to_world, pictures, strict=True):
        depth = _cell_depths(xyz, camera, pose, middles.shape[:2], near_plane)
        empty = shows & np.isnan(depth)
        if not empty.any() or np.isnan(depth).all():
            continue
        nearest = distance_transform_edt(np.isnan(depth), return_distances=False, return_indices=True)
        away = depth[tuple(nearest)][empty]
        rays = (middles[empty] - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
        local = np.column_stack([rays, np.ones(len(rays))]) * away[:, None]
        xyz = np.concatenate([xyz, transform(pose, local)])
        rgb = np.concatenate([rgb, picture[rows[empty], columns[empty]]])
    return xyz, rgb


def _middles(camera: Camera) -> NDArray[np.float64]:
    """(R, C, 2) middle of each cell [px]: column, row."""
    side = max(max(camera.width, camera.height) / CELLS, _LEAST_CELL)
    across, down = (max(round(length / side), 1) for length in (camera.width, camera.height))
    columns = (np.arange(across) + 0.5) * camera.width / across
    rows = (np.arange(down) + 0.5) * camera.height / down
    return np.stack(np.meshgrid(columns, rows), axis=-1)


def _cell_depths(
    xyz: Points, camera: Camera, pose: Points, shape: tuple[int, int], near_plane: float
) -> NDArray[np.float64]:
    """(R, C) median camera z of the points in each cell [m]; NaN where there is none."""
    local = transform(invert(pose), xyz)
    pixels = camera.project(local)
    inside = camera.contains(pixels) & (local[:, 2] >= near_plane)
    size = np.array([camera.width, camera.height]) / shape[::-1]
    column, row = np.minimum((pixels[inside] / size).astype(np.int64), np.array(shape[::-1]) - 1).T
    cell, depth = row * shape[1] + column, local[inside, 2]
    order = np.lexsort((depth, cell))
    cell, depth = cell[order], depth[order]
    found, first, count = np.unique(cell, return_index=True, return_counts=True)
    result = np.full(shape[0] * shape[1], np.nan)
    result[found] = depth[first + (count - 1) // 2]
    return result.reshape(shape)

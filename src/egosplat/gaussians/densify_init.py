"""Add initial points to image cells that show none: windows, plain walls, lamps.

Trackers find points at corners only. Without points, Gaussians grow slowly, and unfinished geometry looks transient.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from egosplat.gaussians.initialization import Points
from egosplat.geometry import Camera, invert, transform

Colours = NDArray[np.uint8]

# Number of cells along the longer side of a photograph.
CELLS = 48

# Smallest side of a cell [px].
_LEAST_CELL = 2.0


def densify(
    xyz: Points,
    rgb: Colours,
    camera: Camera,
    camera_to_world: Points,
    images: Iterable[NDArray[np.uint8]],
    valid: NDArray[np.bool_],
    *,
    near_plane: float,
) -> tuple[Points, Colours]:
    """Add points so that each image cell shows at least one.

    A new point lies in the middle of its cell. Its depth is the median depth of the nearest cell with points, its
    color that of the photograph. Points added for one photograph count for the next. A photograph that shows no
    point at all gets none.

    Args:
        xyz: (P, 3) float64 world points [m], finite.
        rgb: (P, 3) uint8.
        camera: shared by all photographs.
        camera_to_world: (V, 4, 4) float64.
        images: V images (H, W, 3) uint8, read one at a time.
        valid: (H, W) bool; cells with an invalid middle get no point.
        near_plane: smallest camera z [m].

    Returns:
        (P + N, 3) float64 and (P + N, 3) uint8: the given points, then the new ones.
    """
    centers = _cell_centers(camera)
    columns, rows = centers.astype(np.int64).transpose(2, 0, 1)
    shows = valid[rows, columns]
    for pose, image in zip(camera_to_world, images, strict=True):
        depth = _cell_depths(xyz, camera, pose, centers.shape[:2], near_plane)
        empty = shows & np.isnan(depth)
        if not empty.any() or np.isnan(depth).all():
            continue
        nearest = distance_transform_edt(np.isnan(depth), return_distances=False, return_indices=True)
        nearest_depth = depth[tuple(nearest)][empty]
        rays = (centers[empty] - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
        local = np.column_stack([rays, np.ones(len(rays))]) * nearest_depth[:, None]
        xyz = np.concatenate([xyz, transform(pose, local)])
        rgb = np.concatenate([rgb, image[rows[empty], columns[empty]]])
    return xyz, rgb


def _cell_centers(camera: Camera) -> NDArray[np.float64]:
    """Return the (R, C, 2) middle of each cell [px], column first."""
    side = max(max(camera.width, camera.height) / CELLS, _LEAST_CELL)
    across, down = (max(round(length / side), 1) for length in (camera.width, camera.height))
    columns = (np.arange(across) + 0.5) * camera.width / across
    rows = (np.arange(down) + 0.5) * camera.height / down
    return np.stack(np.meshgrid(columns, rows), axis=-1)


def _cell_depths(
    xyz: Points, camera: Camera, pose: Points, shape: tuple[int, int], near_plane: float
) -> NDArray[np.float64]:
    """Return the (R, C) median camera z of the points in each cell [m], NaN for an empty cell."""
    local = transform(invert(pose), xyz)
    pixels = camera.project(local)
    inside = camera.contains(pixels) & (local[:, 2] >= near_plane)
    size = np.array([camera.width, camera.height]) / shape[::-1]
    # Rounding may put a pixel at the border into the cell beyond the last one.
    column, row = np.minimum((pixels[inside] / size).astype(np.int64), np.array(shape[::-1]) - 1).T
    cell, depth = row * shape[1] + column, local[inside, 2]
    order = np.lexsort((depth, cell))
    cell, depth = cell[order], depth[order]
    found, first, count = np.unique(cell, return_index=True, return_counts=True)
    result = np.full(shape[0] * shape[1], np.nan)
    # The lower median: depths are sorted within each cell.
    result[found] = depth[first + (count - 1) // 2]
    return result.reshape(shape)

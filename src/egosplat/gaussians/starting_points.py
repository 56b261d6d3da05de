"""Choose the points of a scene that training starts from, and add points to image cells that show none.

Trackers find points at corners only. On windows, plain walls and lamps Gaussians grow slowly without points, and
unfinished geometry looks transient.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import length_unit
from egosplat.errors import UserError
from egosplat.gaussians.corrections import seen_depths
from egosplat.gaussians.initialization import (
    Points,
    from_points,
    random_points,
    random_subset,
    scene_extent,
    seen,
)
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.training_views import Views
from egosplat.geometry import Camera, invert, transform
from egosplat.progress import log
from egosplat.rasterize.contract import FAR_PLANE

Colors = NDArray[np.uint8]

# Number of cells along the longer side of a photograph, about 11 px of 512.
CELLS = 48

# Smallest side of a cell [px].
_LEAST_CELL = 2.0


def densify(
    xyz: Points,
    rgb: Colors,
    camera: Camera,
    camera_to_world: Points,
    images: Iterable[NDArray[np.uint8]],
    valid: NDArray[np.bool_],
    *,
    near_plane: float,
) -> tuple[Points, Colors]:
    """Add points so that each image cell shows at least one.

    A new point lies in the middle of its cell. Its depth is the median depth of the nearest cell with points, its
    color that of the photograph. Points added for one photograph count for the next. A photograph that shows no
    point at all gets none.

    Args:
        xyz: (P, 3) float64 world points [m], finite.
        rgb: (P, 3) uint8.
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
        # In the image, not in space: neighboring cells mostly show the same surface.
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


# Largest number of training views that are searched for empty cells, evenly spaced.
_DENSIFIED_VIEWS = 200

# Largest acceptable float32 step of positions, in scene extents: a quarter of a pixel at 2 m distance.
_COARSEST = 1e-3


def starting_gaussians(
    poses: Artifact,
    views: Views,
    *,
    max_points: int,
    densify_init: bool,
    sh_degree: int,
    near_plane: float,
    seed: int,
) -> Gaussians:
    """Initialize Gaussians at the points visible from training cameras, or at random points if there are none.

    Args:
        max_points: size of the random subset of the points, or number of random points.
        densify_init: add points where a view shows none; see ``egosplat.gaussians.starting_points``.
        sh_degree: degree of the allocated SH coefficients.
        near_plane: smallest camera z of a visible point [m].

    Returns:
        Gaussians on the views' device, without features, that do not require gradients.

    Raises:
        UserError: the scene is too far from the world's origin for float32, or too small or too large for the renderer.
    """
    cameras = views.camera_to_world
    _check_origin(poses, cameras, near_plane)
    xyz, rgb = poses.read("points/xyz"), poses.read("points/rgb")
    _check_depths(poses, xyz, views, near_plane)
    visible = seen(xyz, views.camera, cameras, near_plane=near_plane)
    log(f"{visible.sum()} of {len(xyz)} points are visible in training views")
    xyz, rgb = xyz[visible], rgb[visible]
    if not len(xyz):
        log(f"no initial points: starting from {max_points} random points")
        xyz, rgb = random_points(max_points, views.camera, cameras, near_plane=near_plane, seed=seed)
    elif densify_init:
        # Points beyond the budget are dropped before, because each view projects all of them.
        xyz, rgb = _densify(*_subset(xyz, rgb, max_points, seed), views, max_points, near_plane, seed)
    keys = {"sh_degree": sh_degree, "max_points": max_points, "seed": seed}
    start = from_points(xyz, rgb, feature_channels=0, near_plane=near_plane, **keys)
    return start.to(views.device)


def _densify(
    xyz: Points, rgb: Colors, views: Views, max_points: int, near_plane: float, seed: int
) -> tuple[Points, Colors]:
    """Add points where views show none, and thin the given points to at least half of ``max_points``."""
    chosen = np.unique(np.linspace(0, len(views) - 1, _DENSIFIED_VIEWS).round().astype(int))
    every, colors = densify(
        xyz,
        rgb,
        views.camera,
        views.camera_to_world[chosen],
        (views.pictures[view].numpy() for view in chosen),
        np.ones(views.pictures.shape[1:3], bool) if views.valid is None else views.valid.cpu().numpy() > 0,
        near_plane=near_plane,
    )
    given, added = len(xyz), len(every) - len(xyz)
    log(f"{added} points added where views show none")
    # New points get at most half of the budget.
    kept = _subset(xyz, rgb, max(max_points - added, max_points // 2), seed)
    new = _subset(every[given:], colors[given:], max_points - len(kept[0]), seed)
    return np.concatenate([kept[0], new[0]]), np.concatenate([kept[1], new[1]])


def _subset(xyz: Points, rgb: Colors, most: int, seed: int) -> tuple[Points, Colors]:
    chosen = random_subset(len(xyz), most, seed)
    return xyz[chosen], rgb[chosen]


def _check_origin(poses: Artifact, camera_to_world: Points, near_plane: float) -> None:
    farthest = float(np.abs(camera_to_world[:, :3, 3]).max())
    # Gaussians are float32: far from the origin, neighboring numbers are too far apart.
    step = float(np.spacing(np.float32(farthest)))
    if not step <= _COARSEST * scene_extent(camera_to_world, near_plane):
        raise UserError(
            f"{poses.path}: cameras are {farthest:.3g} m from the world's origin, where float32 resolves positions to "
            f"{step:.2g} m only; move the origin into the scene"
        )


def _check_depths(poses: Artifact, xyz: Points, views: Views, near_plane: float) -> None:
    """Check that the renderer shows most of the scene: otherwise the world has another unit than the near plane."""
    depths = seen_depths(xyz, views, 0.0)
    spread = float(np.ptp(views.camera_to_world[:, :3, 3], axis=0).max())
    known = poses.facts["notes"].get("source") == "known"
    depth = float(np.median(depths)) if len(depths) else spread
    remedies = [f"set run.near_plane={depth / 20:.1g}"] if depth <= FAR_PLANE else []
    if known:
        file = poses.facts["notes"]["file"]
        remedies.insert(0, f"set poses.meters_per_unit to the meters of one unit of {file}")
    advice = f"To repair it, {', or '.join(remedies) or 'scale the poses and points'}"
    if len(depths) and np.mean((depths >= near_plane) & (depths <= FAR_PLANE)) < 0.5:
        raise UserError(
            f"{poses.path}: the median depth of its points is {depth:.2g}; Gaussians are rendered from run.near_plane = "
            f"{near_plane:g} to {FAR_PLANE:g} only.\n{advice}"
        )
    # Without points, cameras at nearly one place only turn, unless nothing tells the unit.
    if known and length_unit(poses) != "m" and not len(xyz) and 0 < spread < near_plane:
        raise UserError(
            f"{poses.path}: without points, and its cameras lie within {spread:.2g}, less than run.near_plane = "
            f"{near_plane:g}.\n{advice}"
        )

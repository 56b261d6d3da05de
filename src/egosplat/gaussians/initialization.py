"""Initialize Gaussians at the points of the poses artifact, and at image cells that show none. Trackers find
points at corners only. On windows, plain walls and lamps Gaussians grow slowly without points, and unfinished
geometry looks transient. Points are float64 NumPy arrays, Gaussians float32 tensors."""

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt
from scipy.spatial import KDTree

from egosplat.arrays import Array, Bools, Bytes, Ints
from egosplat.artifacts.reader import Artifact
from egosplat.errors import UserError
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.schedule import TrainingOptions
from egosplat.gaussians.training_views import Views
from egosplat.geometry import Camera, invert, transform
from egosplat.images import evenly_spaced
from egosplat.progress import log
from egosplat.rasterize.contract import FAR_PLANE

# The constant spherical harmonic 1 / (2 sqrt(pi)): color = SH_C0 * coefficient + 0.5.
SH_C0 = 0.28209479177387814

# As in 3DGS.
INITIAL_OPACITY = 0.1

# Lengths are in near planes, so that a scene in any unit starts as the same scene in meters does; in meters, the near
# plane is 0.1. Floor of the squared neighbor distance, as in 3DGS: a Gaussian at a duplicate point is 0.3 mm wide, not 0.
_LEAST_SQUARED_DISTANCE = 1e-5

# Width of the Gaussian at a lone point, and the scene extent for a camera that hardly moves.
_LONE_SCALE, _LEAST_EXTENT = 1.0, 10.0

# Number of cells along the longer side of a photograph, about 11 px of 512; smallest side of a cell [px].
CELLS, _LEAST_CELL = 48, 2.0

# Largest numbers of evenly spaced training views that are searched for empty cells, and that measure depths.
_DENSIFIED_VIEWS, _DEPTH_VIEWS = 200, 20

# Of the points to start from, at most one in so many is not near.
_FAR_PART = 5

# Largest acceptable float32 step of positions, in scene extents: a quarter of a pixel at 2 m distance.
_COARSEST = 1e-3


def starting_gaussians(poses: Artifact, views: Views, options: TrainingOptions) -> Gaussians:
    """Gaussians, without features, at the points visible from training cameras, and in cells without any. UserError: the scene is too far
    from the world's origin for float32, or too small or too large for the renderer."""
    cameras, near_plane, seed = views.camera_to_world, options.render.near_plane, options.seed
    max_points = min(options.max_points, options.max_gaussians)
    _check_origin(poses, cameras, near_plane)
    xyz, rgb = poses.read("points/xyz"), poses.read("points/rgb")
    _check_depths(poses, xyz, views, near_plane)
    visible = seen(xyz, views.camera, cameras, near_plane=near_plane)
    if views.near is not None:
        far = np.flatnonzero(visible & ~views.near(xyz))
        visible[far] = False
        visible[far[_random_subset(len(far), max_points // _FAR_PART, seed)]] = True
    log(f"{visible.sum()} of {len(xyz)} points are visible in training views")
    xyz, rgb = xyz[visible], rgb[visible]
    if options.densify_init or not len(xyz):
        # Points beyond the budget are dropped before, because each view projects all of them.
        xyz, rgb = _densify(*_subset(xyz, rgb, max_points, seed), views, max_points, near_plane, seed)
    keys = {"sh_degree": options.sh_degree, "max_points": max_points, "seed": seed}
    return from_points(xyz, rgb, near_plane=near_plane, **keys).to(views.device)


def _check_origin(poses: Artifact, camera_to_world: Array, near_plane: float) -> None:
    farthest = float(np.abs(camera_to_world[:, :3, 3]).max())
    # Gaussians are float32: far from the origin, neighboring numbers are too far apart.
    step = float(np.spacing(np.float32(farthest)))
    if not step <= _COARSEST * scene_extent(camera_to_world, near_plane):
        raise UserError(
            f"{poses.path}: cameras are {farthest:.3g} m from the world's origin, where float32 resolves positions to "
            f"{step:.2g} m only; move the origin into the scene"
        )


def _check_depths(poses: Artifact, xyz: Array, views: Views, near_plane: float) -> None:
    """Check that the renderer shows most of the scene: otherwise the world has another unit than the near plane."""
    depths = seen_depths(xyz, views, 0.0)
    if not len(depths) or np.mean((depths >= near_plane) & (depths <= FAR_PLANE)) >= 0.5:
        return
    depth = float(np.median(depths))
    remedies = [f"set run.near_plane={depth / 20:.1g}"] if depth <= FAR_PLANE else []
    if poses.facts["notes"].get("source") == "known":
        file = poses.facts["notes"]["file"]
        remedies.insert(0, f"set poses.meters_per_unit to the meters of one unit of {file}")
    advice = f"To repair it, {', or '.join(remedies) or 'scale the poses and points'}"
    raise UserError(
        f"{poses.path}: the median depth of its points is {depth:.2g}; Gaussians are rendered from run.near_plane = "
        f"{near_plane:g} to {FAR_PLANE:g} only.\n{advice}"
    )


def _densify(
    xyz: Array, rgb: Bytes, views: Views, max_points: int, near_plane: float, seed: int
) -> tuple[Array, Bytes]:
    """Add points where views show none, and thin the given points to at least half of ``max_points``."""
    every, colors = densify(xyz, rgb, views, near_plane)
    given, added = len(xyz), len(every) - len(xyz)
    log(f"{added} points added where views show none")
    # New points get at most half of the budget.
    kept = _subset(xyz, rgb, max(max_points - added, max_points // 2), seed)
    new = _subset(every[given:], colors[given:], max_points - len(kept[0]), seed)
    return np.concatenate([kept[0], new[0]]), np.concatenate([kept[1], new[1]])


def _subset(xyz: Array, rgb: Bytes, most: int, seed: int) -> tuple[Array, Bytes]:
    chosen = _random_subset(len(xyz), most, seed)
    return xyz[chosen], rgb[chosen]


def _random_subset(count: int, most: int, seed: int) -> Ints:
    """Return sorted indices of at most ``most`` of ``count`` items: all, or a random subset."""
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(seed).choice(count, most, replace=False))


def densify(xyz: Array, rgb: Bytes, views: Views, near_plane: float) -> tuple[Array, Bytes]:
    """Points and colors, with new ones at the end so that each image cell of evenly spaced views shows one, if it
    shows any. A new point lies in the middle of its cell. Its depth is the median depth of the nearest cell
    with points, its color that of the photograph. Points added for one photograph count for the next. Without any
    point, depths are random, uniform in the volume that a view shows up to three scene extents (gsplat). ``xyz``,
    ``rgb``: (P, 3) float64 world points [m], finite, and (P, 3) uint8. Cells with an invalid middle get none."""
    camera = views.camera
    centers = _cell_centers(camera)
    columns, rows = centers.astype(np.int64).transpose(2, 0, 1)
    known, extent = len(xyz) > 0, scene_extent(views.camera_to_world, near_plane)
    shows = np.ones(rows.shape, bool) if views.valid is None else views.valid.cpu().numpy()[rows, columns] > 0
    for view in evenly_spaced(len(views), _DENSIFIED_VIEWS):
        pose, image = views.camera_to_world[view], views.pictures[view].numpy()
        if known:
            depth = _cell_depths(xyz, camera, pose, centers.shape[:2], near_plane)
        else:
            depth = near_plane + 3.0 * extent * np.cbrt(np.random.default_rng(view).uniform(size=rows.shape))
        empty = shows & (np.isnan(depth) | (not known))
        if not empty.any() or np.isnan(depth).all():
            continue
        # In the image, not in space: neighboring cells mostly show the same surface.
        _, nearest = distance_transform_edt(np.isnan(depth), return_indices=True)
        nearest_depth = depth[tuple(nearest)][empty]
        rays = (centers[empty] - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
        local = np.column_stack([rays, np.ones(len(rays))]) * nearest_depth[:, None]
        xyz = np.concatenate([xyz, transform(pose, local)])
        rgb = np.concatenate([rgb, image[rows[empty], columns[empty]]])
    return xyz, rgb


def _cell_centers(camera: Camera) -> Array:
    """Return the (R, C, 2) middle of each cell [px], column first."""
    side = max(max(camera.width, camera.height) / CELLS, _LEAST_CELL)
    across, down = (max(round(length / side), 1) for length in (camera.width, camera.height))
    columns = (np.arange(across) + 0.5) * camera.width / across
    rows = (np.arange(down) + 0.5) * camera.height / down
    return np.stack(np.meshgrid(columns, rows), axis=-1)


def _cell_depths(xyz: Array, camera: Camera, pose: Array, shape: tuple[int, int], near_plane: float) -> Array:
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
    occupied, first, count = np.unique(cell, return_index=True, return_counts=True)
    result = np.full(shape[0] * shape[1], np.nan)
    # The lower median: depths are sorted within each cell.
    result[occupied] = depth[first + (count - 1) // 2]
    return result.reshape(shape)


def from_points(
    xyz: Array, rgb: Bytes, *, sh_degree: int, max_points: int, seed: int, near_plane: float = 0.1
) -> Gaussians:
    """Place one isotropic Gaussian at each point, scaled by the distance to its neighbors (3DGS), on the CPU. Drops points that are not
    finite and keeps a random subset of at most ``max_points``. Opacity is 0.1, rotation the identity; SH coefficients above degree 0 are
    zero, and there are no features. UserError: no point is finite in float32. ``xyz``, ``rgb``: (P, 3) float64 world points [m],
    duplicates allowed, and (P, 3) uint8. ``near_plane``: smallest camera z [m], the unit of the least sizes."""
    # Gaussians are float32, so points must be finite in float32. NaN compares as False.
    kept = np.flatnonzero((np.abs(xyz) <= np.finfo(np.float32).max).all(axis=1))
    if not len(kept):
        raise UserError(
            "splats: no point to start from is finite, or no pixel is valid; check the poses' points"
        )
    kept = kept[_random_subset(len(kept), max_points, seed)]
    points, count = xyz[kept], len(kept)
    sh = torch.zeros(count, (sh_degree + 1) ** 2, 3)
    sh[:, 0] = torch.from_numpy((rgb[kept] / 255.0 - 0.5) / SH_C0)
    log_scales = torch.from_numpy(np.log(neighbor_distance(points, near_plane))).float()
    return Gaussians(
        means=torch.from_numpy(points).float(),
        quats=torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        log_scales=log_scales[:, None].repeat(1, 3),
        logit_opacities=torch.full((count,), INITIAL_OPACITY).logit(),
        sh=sh,
        features=torch.zeros(count, 0),
    )


def neighbor_distance(points: Array, near_plane: float = 0.1) -> Array:
    """Return the (P,) float64 RMS distance [m] of each of (P, 3) points to its three nearest neighbors. Uses
    fewer neighbors if there are fewer. A lone point gets the near plane; the minimum is 0.3 % of it."""
    if len(points) < 2:
        return np.full(len(points), _LONE_SCALE * near_plane)
    neighbors = min(3, len(points) - 1)
    # The nearest match is the point itself or a duplicate of it, at distance zero.
    distances, _ = KDTree(points).query(points, k=neighbors + 1)
    least = _LEAST_SQUARED_DISTANCE * near_plane**2
    return np.sqrt(np.maximum((distances[:, 1:] ** 2).mean(axis=1), least))


def scene_extent(camera_to_world: Array, near_plane: float = 0.1) -> float:
    """Return the scene size [m]: 1.1 times the largest distance of a camera from the mean camera (3DGS). The
    learning rate of the means and the split and prune sizes scale with it. It is at least 10 near planes [m].
    ValueError: there is no (F, 4, 4) pose, or one is not finite."""
    centers = camera_to_world[:, :3, 3]
    if not len(centers) or not np.isfinite(centers).all():
        raise ValueError(f"camera_to_world {camera_to_world.shape} has no pose or one that is not finite")
    distances = np.linalg.norm(centers - centers.mean(axis=0), axis=1)
    # A camera that only rotates has extent 0; the floor keeps learning rates and prune sizes positive.
    return max(1.1 * float(distances.max()), _LEAST_EXTENT * near_plane)


def seen(points: Array, camera: Camera, camera_to_world: Array, *, near_plane: float) -> Bools:
    """(P,) bool: which (P, 3) world points [m] lie in the image of at least one of (F, 4, 4) cameras,
    whatever hides them. False for a point that is not finite, or nearer than ``near_plane`` [m]."""
    result = np.zeros(len(points), dtype=bool)
    unseen = np.flatnonzero(np.isfinite(points).all(axis=1))
    for world_to_camera in invert(camera_to_world):
        inside = in_picture(transform(world_to_camera, points[unseen]), camera, near_plane=near_plane)
        result[unseen[inside]] = True
        unseen = unseen[~inside]
        if not len(unseen):
            break
    return result


def seen_depths(points: Array, views: Views, near_plane: float) -> Array:
    """(S,) depths of the points (P, 3) in evenly spaced views that show them, at ``near_plane`` or beyond [m]."""
    depths = []
    for pose in views.camera_to_world[evenly_spaced(len(views), _DEPTH_VIEWS)]:
        local = transform(invert(pose), points)
        depths.append(local[in_picture(local, views.camera, near_plane=near_plane), 2])
    return np.concatenate([np.zeros(0), *depths])


def in_picture(local: Array, camera: Camera, *, near_plane: float) -> Bools:
    """Test which points (P, 3) in camera axes [m] lie in the image, at ``near_plane`` or beyond; (P,) bool."""
    return camera.contains(camera.project(local)) & (local[:, 2] >= near_plane)

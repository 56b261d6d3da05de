"""Semi-dense points like those of Aria's mapping: on textured, visible surfaces, noisier with distance."""

import numpy as np
from numpy.typing import NDArray

from egosplat.geometry import compose, invert, rotate
from egosplat.images import evenly_spaced
from egosplat_apartments.arrays import Array, Rng
from egosplat_apartments.camera.drift import Drift
from egosplat_apartments.camera.raycasting import interpolated
from egosplat_apartments.camera.render import Renderer
from egosplat_apartments.world.world import World

_COUNT = 40_000
_VIEWS = 60
_GOOD_INV_STD, _BAD_INV_STD = 0.0004, 0.004
_BAD_SHARE = 0.12
# Scale at which texture is detected.
_DETAIL_M = 0.012


def semidense_points(
    world: World, renderer: Renderer, captures: NDArray[np.int64], rng: Rng, drift: Drift | None = None
) -> tuple[Array, Array, Array]:
    """(P, 3) points [m], (P,) uncertainty of the inverse distance [1/m] and (P,) of the distance [m].

    Only static surfaces have points, because mapping from several views rejects moving ones. The points of a view
    drift with the device's estimated pose at that time.
    """
    chosen = evenly_spaced(len(captures), _VIEWS)
    seconds = (captures[chosen] - world.start_ns) * 1e-9
    poses = world.head.world_from_camera(seconds)
    share = -(-_COUNT // len(poses))
    samples = [_sample_surface(renderer, pose, share, rng) for pose in poses]
    exact = np.concatenate([points for points, _ in samples])
    distance = np.concatenate([distances for _, distances in samples])
    eyes = np.repeat(poses[:, :3, 3], [len(points) for points, _ in samples], axis=0)
    bad = rng.random(len(exact)) < _BAD_SHARE
    inverse_std = np.where(bad, _BAD_INV_STD, _GOOD_INV_STD) * rng.lognormal(0, 0.35, len(exact))
    # Mapping estimates inverse distances: noise is added to 1/d, and sigma(d) = d² sigma(1/d).
    noisy = 1 / np.maximum(1 / distance + rng.normal(0, inverse_std), 1 / 50)
    points = eyes + (exact - eyes) * (noisy / distance)[:, None]
    if drift is not None:
        device = world.head.device_pose(world.start_ns)(captures[chosen])
        moved = compose(drift(device, captures[chosen]), invert(device))
        view = np.repeat(np.arange(len(poses)), [len(found) for found, _ in samples])
        points = np.einsum("nij,nj->ni", moved[view, :3, :3], points) + moved[view, :3, 3]
    return points, inverse_std, distance**2 * inverse_std * np.where(bad, 4.0, 1.0)


def _sample_surface(
    renderer: Renderer, world_from_camera: Array, count: int, rng: Rng
) -> tuple[Array, Array]:
    """Points on static surfaces that a camera sees, denser where there is texture.

    Returns:
        (N, 3) float64 points in the world and (N,) their distances [m]; N is at most ``count``.
    """
    geometry, lens = renderer.geometry, renderer.lens
    chosen = rng.choice(len(lens.directions), min(4 * count, len(lens.directions)), replace=False)
    turn, origin = (part.astype(np.float32) for part in (world_from_camera[:3, :3], world_from_camera[:3, 3]))
    rays = rotate(turn, lens.directions[chosen])
    hits = renderer.static.cast(origin, rays)
    texture = geometry.part_texture[geometry.face_part[hits.face]]
    [uv] = interpolated(geometry, hits, geometry.uv)
    width = np.full(len(uv), _DETAIL_M, dtype=np.float32)
    here, aside = (renderer.atlas.albedo(texture, uv + shift, width) for shift in (0, np.float32(_DETAIL_M)))
    # Contrast in display values over one step of _DETAIL_M decides how likely a point is.
    contrast = np.abs(np.sqrt(here) - np.sqrt(aside)).sum(axis=1) + 0.02
    wanted = (hits.face >= 0) & (rng.random(len(uv)) < np.minimum(1, contrast / 0.25))
    best = np.flatnonzero(wanted)[:count]
    distance = hits.distance[best].astype(np.float64)
    return world_from_camera[:3, 3] + distance[:, None] * rays[best].astype(np.float64), distance

"""Find the connected sets of Gaussians that match a query of the whole scene."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from torch import Tensor

from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.geometry import Array, Camera, known_poses
from egosplat.images import evenly_spaced
from egosplat.progress import track
from egosplat.query.answers import Thing
from egosplat.query.maps import Mask
from egosplat.query.options import QueryOptions
from egosplat.query.scene import QueryScene, rendering_camera
from egosplat.query.text import Texts
from egosplat.rasterize.view import sum_over_pixels

# Maximum number of rendered views, evenly spaced among the frames with a pose: they cover a whole recording.
MOST_VIEWS = 64

# Longer side of these views [px]: a thing of a thousandth of the image still has about 20 pixels.
VIEW_SIDE = 192

# Number of neighbors of a Gaussian, itself included: a patch of about four by four on a surface.
NEAREST = 16

# Extent of a Gaussian in standard deviations: its weight there is about an eighth.
REACH = 2.0

# Minimum number of Gaussians of a thing: fewer are less than one neighborhood, where relevancy is noise.
LEAST_GAUSSIANS = 16

# Quantiles of a thing's box, weighted by visible share: single Gaussians far away do not enlarge it.
EXTENT = (0.02, 0.98)

# Two things are duplicates if they share more than this part of the smaller one's visible share.
SAME = 0.25

# Relevancies held at a time, 512 MiB in float32. More queries are answered in batches.
_NUMBERS_AT_ONCE = 2**27

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Surface:
    """N Gaussians with their visibility in V views and their codes' shares at L levels: what all queries share.

    Attributes:
        means: (N, 3) float64 centers.
        touching: (N, N) neighbors, see ``find_neighbors``.
        shares: (V, N) float32 share of each view that a Gaussian fills, see ``visible_shares``.
        weight: (N, L) float32 mean of ``shares`` over the views, times the share of the Gaussian with a code.
        frame: (V,) int64 frames of the views.
        levels: names of the levels.
    """

    means: Array
    touching: csr_array
    shares: Floats
    weight: Floats
    frame: NDArray[np.int64]
    levels: Sequence[str]

    @cached_property
    def averaging(self) -> tuple[csr_array, ...]:
        """L matrices, see ``averaging``."""
        return tuple(averaging(self.touching, level) for level in self.weight.T)


def read_surface(scene: QueryScene, camera_to_world: Array, camera: Camera, valid: Mask | None) -> Surface:
    """Measure which Gaussians the frames of a recording show, and find their neighbors.

    Args:
        camera_to_world: (F, 4, 4) float64, NaN without a pose; at least one frame has one.
        valid: (H, W) bool pixels that show the scene, or None for all.
    """
    registered = known_poses(camera_to_world)
    frame = registered[evenly_spaced(len(registered), MOST_VIEWS)]
    small = rendering_camera(camera, VIEW_SIDE)
    seen = None if valid is None else _shrunk(valid, small)
    views = track(camera_to_world[frame], "rendering views", unit="view")
    gaussians = scene.gaussians
    shares = visible_shares(gaussians, small, views, seen, scene.settings).cpu().numpy()
    means = gaussians.means.double().cpu().numpy()
    touching = find_neighbors(means, gaussians.scales.amax(dim=1).double().cpu().numpy())
    weight = shares.mean(axis=0)[:, None] * scene.share.cpu().numpy()
    return Surface(means, touching, shares, weight, frame, scene.levels)


def ask_scene(
    scene: QueryScene, surface: Surface, texts: Texts, options: QueryOptions, most: int
) -> Iterator[tuple[Thing, ...]]:
    """Find the things that match queries, in order.

    Args:
        texts: the queries, encoded by the model that made the scene's features.
        options: ``temperature``, ``segmentation_threshold`` and ``box_filter`` are used.
        most: maximum number of things of a query.

    Returns:
        Of each query the things by decreasing score; none if no Gaussian has a code.
    """
    count, levels = scene.share.shape
    for batch in texts.in_batches(max(1, _NUMBERS_AT_ONCE // max(1, levels * count))):
        for relevancy in scene.relevancy(batch, options.temperature).cpu().numpy():
            yield tuple(
                find_things(surface, relevancy, options.segmentation_threshold, options.box_filter, most)
            )


def visible_shares(
    gaussians: Gaussians, camera: Camera, poses: Iterable[Array], valid: Mask | None, settings: RenderSettings
) -> Tensor:
    """Share of each view that every Gaussian fills, with occlusion.

    Pixels count less towards the border, where things are cut off.

    Args:
        camera: camera of all views, at the resolution to measure in.
        poses: V (4, 4) float64 camera_to_world.
        valid: (height, width) bool pixels of the camera that show the scene, or None for all.

    Returns:
        (V, N) float32 on the device of the Gaussians; each row sums to at most about 1.
    """
    # An image is linear in the values of the Gaussians, so the transposed map of an image of ones sums the compositing
    # weights of each Gaussian.
    ones = torch.from_numpy(_window(camera, valid)).to(gaussians.means.device)
    views = (view_of(gaussians, camera, pose, settings) for pose in poses)
    rows = [sum_over_pixels(view, ones[..., None])[:, 0] for view in views]
    return torch.stack(rows) if rows else ones.new_zeros(0, gaussians.count)


def _window(camera: Camera, valid: Mask | None) -> np.ndarray:
    """(H, W) float32 weight of each pixel; the weights of all pixels sum to 1, invalid ones are set to 0."""
    # A half sine along each axis falls towards the border.
    down, right = (np.sin(np.pi * (np.arange(side) + 0.5) / side) for side in (camera.height, camera.width))
    window = np.outer(down, right)
    window /= window.sum()
    return np.where(True if valid is None else valid, window, 0.0).astype(np.float32)


def _shrunk(valid: Mask, camera: Camera) -> Mask:
    """Sample a mask at the pixel centers of a smaller camera, (h, w) bool."""
    size = camera.width, camera.height
    return cv2.resize(valid.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST_EXACT) > 0


def find_neighbors(means: Array, radii: Array) -> csr_array:
    """Find the neighbors of N Gaussians.

    Args:
        means: (N, 3) float64 centers.
        radii: (N,) float64 standard deviations along the longest axis, in the unit of the centers.

    Returns:
        (N, N) sparse float32: 1 where one Gaussian is among the nearest of another and their extents (see ``REACH``)
        overlap; 1 on the diagonal.
    """
    size, count = len(means), min(NEAREST, len(means))
    if not count:
        return csr_array((0, 0), dtype=np.float32)
    # A fixed number of neighbors adapts to the density; a radius would join everything in dense regions.
    tree = cKDTree(means)
    # In the order of the tree, so that each search finds in the processor's cache what the one before has read.
    order = tree.indices
    distance, nearest = tree.query(means[order], k=np.arange(1, count + 1), workers=-1)
    row, column = np.nonzero(distance <= REACH * (radii[order, None] + radii[nearest]))
    ones = np.ones(len(row), np.float32)
    return csr_array((ones, (order[row], nearest[row, column])), shape=(size, size))


def averaging(touching: csr_array, weights: Floats) -> csr_array:
    """The matrix that averages values over each Gaussian and its neighbors.

    Args:
        touching: of ``find_neighbors``.
        weights: (N,) non-negative weights of the Gaussians.

    Returns:
        (N, N) sparse float32 whose rows sum to 1, or to 0 where all weights are 0.
    """
    weights = weights.astype(np.float32)
    total = touching @ weights
    inverse = np.divide(1.0, total, out=np.zeros_like(total), where=total > 0)
    # Products with diagonal matrices would sort all entries anew.
    values = np.repeat(inverse, np.diff(touching.indptr)) * weights[touching.indices]
    return csr_array((values, touching.indices, touching.indptr), shape=touching.shape)


def find_things(
    surface: Surface, relevancy: Floats, threshold: float, box_side: float, most: int
) -> list[Thing]:
    """Find the things that match a query best (docs/method.md#scene-queries).

    This is LangSplat's segmentation on Gaussians instead of pixels. At each level, relevancy is averaged over
    neighbors, normalized to 0..1 and thresholded; the Gaussians above the threshold are split into connected
    components.

    Args:
        relevancy: (L, N) float32 in 0..1.
        threshold: threshold of the normalized relevancy, 0..1.
        box_side: side of the box filter, as a share of the image's side.
        most: maximum number of things.

    Returns:
        Things by decreasing score, without duplicates (see ``SAME``).
    """
    found = [
        _thing(surface, values, members, level, box_side)
        for level, values in enumerate(relevancy)
        for members in _parts(surface, values, level, threshold)
    ]
    kept: list[Thing] = []
    for thing in sorted(found, key=lambda one: -one.score):
        if len(kept) == most:
            break
        if not any(_same(thing, other, surface) for other in kept):
            kept.append(thing)
    return kept


def _parts(surface: Surface, values: Floats, level: int, threshold: float) -> list[NDArray[np.int64]]:
    """Members of each connected component above the threshold at a level; specks are left out."""
    seen = surface.weight[:, level] > 0
    if not seen.any():
        return []
    smooth = surface.averaging[level] @ values
    lowest, peak = smooth[seen].min(), smooth[seen].max()
    members = np.flatnonzero(seen & (smooth - lowest > threshold * (peak - lowest)))
    links = surface.touching[members][:, members]
    component = connected_components(links, directed=False)[1].astype(np.int64)
    order = np.argsort(component, kind="stable")
    parts = np.split(members[order], np.flatnonzero(np.diff(component[order])) + 1)
    return [part for part in parts if len(part) >= LEAST_GAUSSIANS]


def _thing(
    surface: Surface, values: Floats, members: NDArray[np.int64], level: int, box_side: float
) -> Thing:
    weight, means = surface.weight[members, level].astype(np.float64), surface.means[members]
    total = weight.sum()
    shown = surface.shares[:, members].sum(axis=1, dtype=np.float64)
    view = int(shown.argmax())
    low, high = np.stack([_quantiles(axis, weight) for axis in means.T], axis=1)
    return Thing(
        # Mean relevancy times A / (A + a): A is the thing's share of its best view, a the share of LangSplat's box
        # filter. In an image, that filter lowers the peak of smaller things by the same factor.
        score=float(weight @ values[members] / total * shown[view] / (shown[view] + box_side**2)),
        level=surface.levels[level],
        center=weight @ means / total,
        size=high - low,
        # The first of the views that show as much.
        frame=int(surface.frame[view]),
        members=members,
    )


def _quantiles(values: Array, weight: Array) -> Array:
    """(2,) weighted quantiles of (M,) values at ``EXTENT``."""
    order = np.argsort(values)
    below = np.cumsum(weight[order])
    places = np.searchsorted(below, np.array(EXTENT) * below[-1])
    return values[order[np.minimum(places, len(values) - 1)]]


def _same(one: Thing, other: Thing, surface: Surface) -> bool:
    common = np.intersect1d(one.members, other.members, assume_unique=True)
    shared, own, others = (
        surface.weight[rows].max(axis=1).sum() for rows in (common, one.members, other.members)
    )
    return bool(shared > SAME * min(own, others))

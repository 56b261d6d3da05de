"""Find the connected sets of Gaussians that match a query of the whole scene."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from torch import Tensor

from egosplat.arrays import Array, Bools, Floats, Ints, Ints32
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.geometry import Camera, ground_axes, known_poses
from egosplat.images import evenly_spaced
from egosplat.progress import track
from egosplat.query.answers import Thing
from egosplat.query.maps import resize_shown
from egosplat.query.options import QueryOptions
from egosplat.query.scene import QueryScene, rendering_camera
from egosplat.query.text import Texts
from egosplat.rasterize.view import sum_over_pixels

# Maximum number of rendered views, evenly spaced among the frames with a pose: they cover a whole recording; and their longer
# side [px]: a thing of a thousandth of the image still has about 20 pixels.
MOST_VIEWS, VIEW_SIDE = 64, 192

# Number of neighbors of a Gaussian, itself included: a patch of about four by four on a surface.
NEAREST = 16

# Extent of a Gaussian in standard deviations: its weight there is about an eighth.
REACH = 2.0

# Minimum number of Gaussians of a thing: fewer are less than one neighborhood, where relevancy is noise.
LEAST_GAUSSIANS = 16

# Quantiles of a thing's box, weighted by visible share: single Gaussians far away do not enlarge it.
EXTENT = (0.02, 0.98)

# Quantiles of the extents of an instance, and of the heights of all Gaussians for the height of the floor.
_INSIDE, _FLOOR = (0.04, 0.96), 0.01

# Two things are duplicates if they share more than this part of the smaller one's visible share.
SAME = 0.25


@dataclass(frozen=True, eq=False)
class Surface:
    """N Gaussians with their visibility in V views and their codes' shares at L levels: what all queries share.

    Attributes:
        means, touching: (N, 3) float64 centers, and (N, N) neighbors, see ``find_neighbors``.
        shares: (V, N) float32 share of each view that a Gaussian fills, see ``visible_shares``; a Gaussian's lie side by side.
        weight: (N, L) float32 mean of ``shares`` over the views, times the share of the Gaussian with a code.
        frame: (V,) int64 frames of the views.
        instance: (N,) int32 instance at the coarsest level, -1 for none; None if instances have no place in 3D.
    """

    means: Array
    touching: csr_array
    shares: Floats
    weight: Floats
    frame: Ints
    levels: Sequence[str]
    instance: Ints32 | None = None

    @cached_property
    def averaging(self) -> tuple[csr_array, ...]:
        """L (N, N) matrices that average values over each Gaussian and its neighbors: rows sum to 1, or to 0 without any weight."""
        touching, found = self.touching, []
        for weight in self.weight.T.astype(np.float32):
            total = touching @ weight
            inverse = np.divide(1.0, total, out=np.zeros_like(total), where=total > 0)
            # Products with diagonal matrices would sort all entries anew.
            values = np.repeat(inverse, np.diff(touching.indptr)) * weight[touching.indices]
            found.append(csr_array((values, touching.indices, touching.indptr), shape=touching.shape))
        return tuple(found)

    def visible(self, rows: Ints) -> float:
        """Visible share of some Gaussians, at the level at which each has most."""
        return self.weight[rows].max(axis=1).sum()

    def instance_of(self, rows: Ints) -> int:
        """The instance that has more than half of the visible share of some Gaussians; -1 for none."""
        if self.instance is None:
            return -1
        weight = self.weight[rows].max(axis=1)
        shares = np.bincount(self.instance[rows] + 1, weight)
        return int(shares.argmax()) - 1 if shares.max() > 0.5 * weight.sum() else -1


def read_surface(scene: QueryScene, camera_to_world: Array, camera: Camera, valid: Bools | None) -> Surface:
    """Measure which Gaussians the frames of a recording show, by (F, 4, 4) float64 poses, NaN without one, and find their neighbors;
    at least one frame has a pose. ``valid`` (H, W) bool pixels show the scene, or all for None."""
    registered, gaussians = known_poses(camera_to_world), scene.gaussians
    frame = registered[evenly_spaced(len(registered), MOST_VIEWS)]
    small = rendering_camera(camera, VIEW_SIDE)
    seen = None if valid is None else resize_shown(valid, small.height, small.width)
    views = track(camera_to_world[frame], "rendering views", unit="view")
    shares = visible_shares(gaussians, small, views, seen, scene.settings).cpu().numpy()
    means = gaussians.means.double().cpu().numpy()
    touching = find_neighbors(means, gaussians.scales.amax(dim=1).double().cpu().numpy())
    weight = shares.mean(axis=0)[:, None] * scene.share.cpu().numpy()
    return Surface(means, touching, np.asfortranarray(shares), weight, frame, scene.levels)


def ask_scene(
    scene: QueryScene, surface: Surface, texts: Texts, options: QueryOptions, most: int
) -> Iterator[list[Thing]]:
    """Find for each query, in order, at most ``most`` things by decreasing score; none if no Gaussian has a code."""
    how = options.segmentation_threshold, options.box_filter, most
    for batch in texts.in_batches(scene.share.numel()):
        for relevancy in scene.relevancy(batch, options).cpu().numpy():
            yield find_things(surface, relevancy, *how)


def visible_shares(
    gaussians: Gaussians,
    camera: Camera,
    poses: Iterable[Array],
    valid: Bools | None,
    settings: RenderSettings,
) -> Tensor:
    """(V, N) float32 share of each view, of V poses, that every Gaussian fills, with occlusion, on its device; rows sum to
    about 1 at most.

    Pixels count less towards the border, where things are cut off; ``valid`` ones show the scene, or all for None.
    """
    # A half sine along each axis falls towards the border; the weights of all pixels sum to 1.
    down, right = (np.sin(np.pi * (np.arange(side) + 0.5) / side) for side in (camera.height, camera.width))
    window = np.outer(down, right)
    window = np.where(True if valid is None else valid, window / window.sum(), 0.0).astype(np.float32)
    # An image is linear in the values of the Gaussians, so the transposed map of an image of ones sums the compositing
    # weights of each Gaussian.
    ones = torch.from_numpy(window).to(gaussians.means.device)
    views = (view_of(gaussians, camera, pose, settings) for pose in poses)
    rows = [sum_over_pixels(view, ones[..., None])[:, 0] for view in views]
    return torch.stack(rows) if rows else ones.new_zeros(0, gaussians.count)


def find_neighbors(means: Array, radii: Array) -> csr_array:
    """(N, N) sparse float32: 1 where a Gaussian is among the nearest of another and they overlap within ``REACH``, and on the
    diagonal; by (N, 3) float64 centers, and (N,) standard deviations along the longest axis."""
    size, count = len(means), min(NEAREST, len(means))
    if not count:
        return csr_array((0, 0), dtype=np.float32)
    # A fixed number of neighbors adapts to the density; a radius would join everything in dense regions.
    tree: Any = KDTree(means)
    # In the order of the tree, so that each search finds in the processor's cache what the one before has read.
    order = tree.indices.astype(np.int32)
    distance, nearest = tree.query(means[order], k=np.arange(1, count + 1), workers=-1)
    row, column = np.nonzero(distance <= REACH * (radii[order, None] + radii[nearest]))
    ones = np.ones(len(row), np.float32)
    return csr_array((ones, (order[row], nearest[row, column].astype(np.int32))), shape=(size, size))


def measure_extents(xyz: Array, instance: Ints32, touching: csr_array, up: Array) -> Array:
    """(I, 5) float64 extents of instances, in the unit of (N, 3) centers: height, longer and shorter side of the footprint, and
    heights of foot and top above the floor; NaN where too few Gaussians show them.

    ``instance`` is (L, N), -1 for none. Only the largest set of Gaussians that touch, by an (N, N) matrix, counts; ``up`` is (3,).
    """
    count = int(instance.max(initial=-1)) + 1
    extents, height, flat = np.full((count, 5), np.nan), xyz @ up, xyz @ ground_axes(up).T
    floor = np.quantile(height, _FLOOR) if len(height) else 0.0
    for own in instance:
        order = np.argsort(own, kind="stable")
        parts = np.split(order, np.searchsorted(own[order], np.arange(count + 1)))[1:-1]
        for index, members in enumerate(parts):
            if len(members):
                label = connected_components(touching[members][:, members], directed=False)[1]
                members = members[label == np.bincount(label).argmax()]
            if len(members) >= LEAST_GAUSSIANS:
                along = flat[members] @ np.linalg.eigh(np.cov(flat[members].T))[1]
                short, long = np.ptp(np.quantile(along, _INSIDE, axis=0), axis=0)
                foot, top = np.quantile(height[members], _INSIDE)
                extents[index] = top - foot, long, short, foot - floor, top - floor
    return extents


def find_things(
    surface: Surface, relevancy: Floats, threshold: float, box_side: float, most: int
) -> list[Thing]:
    """Find at most ``most`` things by decreasing score (docs/answers.md#scene-queries): LangSplat's segmentation on Gaussians.

    At each level, (L, N) relevancy is averaged over neighbors, normalized to 0..1 and thresholded; the Gaussians above the
    threshold are split into connected components. ``box_side`` is that of the box filter, as a share of the image's side.
    """
    every = [
        (*_score(surface, values, members, level, box_side), level, members)
        for level, values in enumerate(relevancy)
        for members in _components(surface, values, level, threshold)
    ]
    kept: list[Thing] = []
    for scored in sorted(every, key=lambda scored: -scored[0]):
        if len(kept) == most:
            break
        thing = _thing(surface, *scored)
        if not any(_same(thing, other, surface) for other in kept):
            kept.append(thing)
    return kept


def _components(surface: Surface, values: Floats, level: int, threshold: float) -> list[Ints]:
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
    sets = np.split(members[order], np.flatnonzero(np.diff(component[order])) + 1)
    return [chosen for chosen in sets if len(chosen) >= LEAST_GAUSSIANS]


def _score(
    surface: Surface, values: Floats, members: Ints, level: int, box_side: float
) -> tuple[float, float, int]:
    """Score of a thing, and the largest share of a view that it fills, with this view, the first of equal ones."""
    weight = surface.weight[members, level].astype(np.float64)
    shown = surface.shares[:, members].sum(axis=1, dtype=np.float64)
    view = int(shown.argmax())
    # Mean relevancy times A / (A + a): A is the thing's share of its best view, a the share of LangSplat's box
    # filter. In an image, that filter lowers the peak of smaller things by the same factor.
    score = float(weight @ values[members] / weight.sum() * shown[view] / (shown[view] + box_side**2))
    return score, float(shown[view]), view


def _thing(surface: Surface, score: float, share: float, view: int, level: int, members: Ints) -> Thing:
    weight, means = surface.weight[members, level].astype(np.float64), surface.means[members]
    low, high = extent_of(means, weight)
    center, frame = weight @ means / weight.sum(), int(surface.frame[view])
    return Thing(score, surface.levels[level], center, high - low, frame, members, share)


def extent_of(points: Array, weight: Array) -> Array:
    """(2, 3) quantiles of (M, 3) points at ``EXTENT``, by their weights."""
    return np.quantile(points, EXTENT, axis=0, weights=weight, method="inverted_cdf")


def _same(thing: Thing, other: Thing, surface: Surface) -> bool:
    """Whether two things of one answer are one: they share Gaussians, the box of one holds the middle of the other, or both are of
    one instance."""
    apart = np.abs(thing.center - other.center)
    if any((apart <= one.size / 2).all() for one in (thing, other)):
        return True
    if (own := surface.instance_of(thing.members)) >= 0 and own == surface.instance_of(other.members):
        return True
    common = np.intersect1d(thing.members, other.members, assume_unique=True)
    smaller = min(surface.visible(thing.members), surface.visible(other.members))
    return bool(surface.visible(common) > SAME * smaller)

"""Lift masks onto Gaussians: in each frame, a Gaussian belongs to the mask at the pixel of its center."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy import sparse

from egosplat.arrays import Bools, Floats, Ints, Ints32, Reals
from egosplat.artifacts.reader import Artifact
from egosplat.gaussians.render import view_of
from egosplat.images import resize_labels
from egosplat.instances.geometry import Geometry
from egosplat.language.centers import look_at_centers
from egosplat.progress import track
from egosplat.rasterize.view import sum_over_pixels

LEAST_SEEN = 0.25
"""Compositing weight [px] from which a frame has seen a Gaussian."""

INSIDE = 0.5
"""Share of its weight from which a Gaussian belongs to masks that hold it."""

_HIDDEN = 1e-3
"""Compositing weight of a Gaussian at its center up to which the pixel shows something else."""


@dataclass(frozen=True, eq=False)
class LiftedMasks:
    """V masks of T frames, lifted onto N Gaussians.

    Attributes:
        instance: (V,) int64 number of the mask's instance in segments.zarr.
        frame: (V,) int64 place of the mask's frame among the T frames, which are ``row``, (T,) int64.
        votes: (N, V) sparse float32, ``seen`` of each Gaussian whose center is inside the mask [px].
        seen: (T, N) sparse float32, compositing weight of each Gaussian in all pixels that count [px]; none where the pixel of
            its center does not count or shows something else.
    """

    instance: Ints
    frame: Ints
    row: Ints
    votes: sparse.csc_array
    seen: sparse.csr_array

    @property
    def weight(self) -> Reals:
        """(N,) mean compositing weight of each Gaussian in the frames that see it [px]."""
        total = np.asarray(self.seen.sum(0), np.float32)
        often = np.bincount(self.seen.indices[self.seen.data >= LEAST_SEEN], minlength=len(total))
        return total / np.maximum(often, 1)

    def select(self, chosen: Bools) -> "LiftedMasks":
        """Select masks by (V,) bool."""
        votes = self.votes[:, np.flatnonzero(chosen)]
        return replace(self, instance=self.instance[chosen], frame=self.frame[chosen], votes=votes)


def holds(votes: Floats, seen: Floats) -> Bools:
    """Whether summed votes are at least the share ``INSIDE`` of the summed seen weights, of Gaussians that are seen."""
    return (seen >= LEAST_SEEN) & (votes >= INSIDE * seen)


def masks_of(thing: Ints) -> list[Ints]:
    """The masks of each thing, from the (V,) thing of each mask, -1 for none; in the order of the things."""
    order = np.argsort(thing, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(thing[order])) + 1)
    return [mine for mine in parts if len(mine) and thing[mine[0]] >= 0]


def lift(
    geometry: Geometry,
    segments: Artifact,
    shown: Callable[[int], Bools],
    select: Callable[[Ints32], tuple[Ints32, Bools]],
) -> LiftedMasks | None:
    """Lift the masks of segments.zarr in all training views; None if no view has a mask. ``shown`` gives the
    (H, W) bool pixels of a frame that show the scene; ``select`` which of its labels (L, h, w) vote, -1 for
    none, and (h, w) bool, which pixels are not counted as seen."""
    gaussians, views = geometry.gaussians, geometry.views
    size = views.camera.width, views.camera.height
    instance, frame, row, votes, seen = [], [], [], [], []
    for place, number in enumerate(track(views.frame.tolist(), "lifting masks")):
        labels, unseen = select(resize_labels(segments.row("labels", number), *size))
        if not (labels >= 0).any():
            continue
        counted = resize_labels(shown(number), *size) & ~unseen
        view = views.camera, views.camera_to_world[place], geometry.settings
        centers = look_at_centers(gaussians, *view)
        x, y = centers.pixel.T
        visible = counted[y, x] & (centers.weight > _HIDDEN)
        # SciPy keeps wider indices, of which an hour has a billion.
        gaussian, found = centers.gaussian[visible].astype(np.int32), labels[:, y[visible], x[visible]]
        pixels = torch.from_numpy(counted).to(gaussians.means)[..., None]
        sums = sum_over_pixels(view_of(gaussians, *view), pixels)[:, 0]
        weight = sums.cpu().numpy()[gaussian]
        seen.append(sparse.csr_array((weight, (np.zeros_like(gaussian), gaussian)), (1, gaussians.count)))
        ids = np.unique(found[found >= 0])
        level, held = np.nonzero(found >= 0)
        where = gaussian[held], np.searchsorted(ids, found[level, held]).astype(np.int32)
        votes.append(sparse.csc_array((weight[held], where), (gaussians.count, len(ids))))
        instance.append(ids)
        frame.append(np.full(len(ids), len(row)))
        row.append(number)
    if not row:
        return None
    return LiftedMasks(
        np.concatenate(instance).astype(np.int64),
        np.concatenate(frame).astype(np.int64),
        np.array(row, np.int64),
        sparse.csc_array(sparse.hstack(votes, format="csc")),
        sparse.csr_array(sparse.vstack(seen, format="csr")),
    )

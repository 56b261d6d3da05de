"""Render things into frames as label maps."""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor

from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, render, view_of
from egosplat.geometry import Camera
from egosplat.rasterize.view import composite_sparse

LEAST_BELIEF = 0.05

# Things rendered in one pass; bounds the memory of their images.
_AT_ONCE = 256

Box = tuple[slice, slice]
"""Rows and columns."""


def render_things(
    gaussians: Gaussians,
    beliefs: Sequence[sparse.csr_array],
    camera: Camera,
    camera_to_world: NDArray[np.float64],
    settings: RenderSettings,
    size: tuple[int, int],
) -> NDArray[np.int32]:
    """(L, H, W) int32 strongest thing of each level at each pixel of label maps of a size (H, W), -1 where
    none is. ``beliefs`` are (N, K) by level, see ``things.beliefs``; the camera is at the working size."""
    _, _, meta = render(
        gaussians, camera, camera_to_world, settings, sh_degree=0, background=None, render_mode="D"
    )
    seen = (meta["radii"][0] > 0).all(dim=-1)
    view, rows = view_of(gaussians.select(seen), camera, camera_to_world, settings), seen.cpu().numpy()
    images = partial(composite_sparse, view)
    return np.stack([_strongest(held[rows], images, size, seen.device) for held in beliefs])


def _strongest(
    beliefs: sparse.csr_array,
    image: Callable[[sparse.csr_array], Tensor],
    size: tuple[int, int],
    device: torch.device,
) -> NDArray[np.int32]:
    """(H, W) strongest thing of one level, from (n, K) beliefs of the Gaussians that a frame shows and their rendering."""
    best = torch.full(size, LEAST_BELIEF, device=device)
    labels = torch.full(size, -1, dtype=torch.int32, device=device)
    near = _near(beliefs)
    for first in range(0, len(near), _AT_ONCE):
        things = near[first : first + _AT_ONCE]
        images = image(beliefs[:, things])
        for place, cells, pixels in _boxes(images > LEAST_BELIEF, size):
            small, so_far = images[place, *cells], best[pixels]
            enlarged = F.interpolate(small[None, None], so_far.shape, mode="bilinear")[0, 0]
            labels[pixels].masked_fill_(enlarged > so_far, int(things[place]))
            torch.maximum(so_far, enlarged, out=so_far)
    return labels.cpu().numpy()


def _near(beliefs: sparse.csr_array) -> NDArray[np.intp]:
    """Things that some Gaussian of (n, K) holds enough of: a pixel, a weighted mean, shows no more than the largest."""
    if not beliefs.nnz:
        return np.zeros(0, np.intp)
    # Rounding may lift a mean above the largest value, by less than a thousandth.
    return np.flatnonzero(beliefs.max(axis=0).toarray().ravel() > 0.999 * LEAST_BELIEF)


def _boxes(shown: Tensor, size: tuple[int, int]) -> Iterator[tuple[int, Box, Box]]:
    """Each thing that (K, h, w) bool images show: its place, the box of cells around it, and that box in
    ``size`` pixels. A thing covers little of a frame, and enlarging whole images would take most of the
    time."""
    rows, columns = shown.any(dim=2).cpu().numpy(), shown.any(dim=1).cpu().numpy()
    for place in np.flatnonzero(rows.any(axis=1)).tolist():
        spans = zip((rows[place], columns[place]), size, strict=True)
        cells, pixels = zip(*(_span(*span) for span in spans), strict=True)
        yield place, cells, pixels


def _span(shown: NDArray[np.bool_], length: int) -> tuple[slice, slice]:
    """The cells from the first to the last of (n,) that is shown, and their pixels where n cells are ``length`` pixels."""
    # A cell more on each side takes part in the interpolation, and a cell's border is a pixel's at both ends.
    parts = math.gcd(len(shown), length)
    step, pixels = len(shown) // parts, length // parts
    first, last = np.flatnonzero(shown)[[0, -1]].tolist()
    start, end = max(first - 1, 0) // step, -(-min(last + 2, len(shown)) // step)
    return slice(start * step, end * step), slice(start * pixels, end * pixels)

"""Render things into frames as label maps."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from scipy import sparse
from torch import Tensor

from egosplat.arrays import Array, Bools, Ints32
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
    camera_to_world: Array,
    settings: RenderSettings,
    size: tuple[int, int],
) -> Ints32:
    """(L, H, W) int32 strongest thing of each level at each pixel of label maps of a size (H, W), -1 where
    none is. ``beliefs`` are (N, K) by level, see ``things.beliefs``; the camera is at the working size."""
    _, _, meta = render(
        gaussians, camera, camera_to_world, settings, sh_degree=0, background=None, render_mode="D"
    )
    seen = (meta["radii"][0] > 0).all(dim=-1)
    view, rows = view_of(gaussians.select(seen), camera, camera_to_world, settings), seen.cpu().numpy()
    # In one pass: the weights of a pixel are found once for all levels.
    held: Any = sparse.hstack([each[rows] for each in beliefs], format="csr")
    counts = [each.shape[1] for each in beliefs]
    level = np.repeat(np.arange(len(counts)), counts)
    number = np.concatenate([np.arange(count) for count in counts])
    best = torch.full((len(beliefs), *size), LEAST_BELIEF, device=seen.device)
    labels = torch.full(best.shape, -1, dtype=torch.int32, device=seen.device)
    # A pixel, a weighted mean, shows no more than the largest; rounding may lift it by less than a thousandth.
    near = np.unique(held.indices[held.data > 0.999 * LEAST_BELIEF])
    for first in range(0, len(near), _AT_ONCE):
        things = near[first : first + _AT_ONCE]
        images = composite_sparse(view, held[:, things])
        for place, cells, pixels in _boxes(images, size):
            where = level[things[place]], *pixels
            small, so_far = images[place, *cells], best[where]
            enlarged = F.interpolate(small[None, None], so_far.shape, mode="bilinear")[0, 0]
            labels[where].masked_fill_(enlarged > so_far, int(number[things[place]]))
            torch.maximum(so_far, enlarged, out=so_far)
    return labels.cpu().numpy()


def _boxes(images: Tensor, size: tuple[int, int]) -> Iterator[tuple[int, Box, Box]]:
    """Each thing that (K, h, w) images show: its place, the box of cells around it, and that box in ``size``
    pixels. A thing covers little of a frame, and enlarging whole images would take most of the time."""
    shown = [(images.amax(dim=across) > LEAST_BELIEF).cpu().numpy() for across in (2, 1)]
    cells, pixels = zip(*map(_spans, shown, size), strict=True)
    for place in np.flatnonzero(shown[0].any(axis=1)).tolist():
        yield place, (cells[0][place], cells[1][place]), (pixels[0][place], pixels[1][place])


def _spans(shown: Bools, length: int) -> tuple[list[slice], list[slice]]:
    """The cells from the first to the last that is shown, of each of (K, n), and their pixels where n cells are
    ``length`` pixels."""
    # A cell more on each side takes part in the interpolation, and a cell's border is a pixel's at both ends.
    count = shown.shape[1]
    parts = math.gcd(count, length)
    step = count // parts
    start = np.maximum(shown.argmax(axis=1) - 1, 0) // step
    end = -(-np.minimum(count + 1 - shown[:, ::-1].argmax(axis=1), count) // step)
    slices = lambda unit: [
        slice(*span) for span in zip((start * unit).tolist(), (end * unit).tolist(), strict=True)
    ]
    return slices(step), slices(length // parts)

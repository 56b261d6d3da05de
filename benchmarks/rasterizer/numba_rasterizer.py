"""A rasterizer in Numba: the same algorithm as the C++ kernels', as one would write it in Python.

Tiles of 16 x 16 pixels, Gaussians nearest first, one row of a tile at a time in loops without branches, which Numba
vectorises; hand-written backward pass; float32, no fast-math. It knows no gradient to alpha.
"""

import functools
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from benchmarks.rasterizer.scenes import Problem
from egosplat.rasterize.contract import ALPHA_THRESHOLD, MAX_ALPHA, MIN_TRANSMITTANCE

TILE = 16

_ZERO, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
_MINUS_SIXTEENTH, _C2, _C3, _C4, _C5, _C6 = (
    np.float32(value) for value in (-1 / 16, 1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720)
)
_MAX_ALPHA, _MIN_TRANSMITTANCE = np.float32(MAX_ALPHA), np.float32(MIN_TRANSMITTANCE)

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]


def prepare(problem: Problem) -> Callable[[], tuple[Tensor, ...]]:
    """A function that returns the image (H, W, X), then the gradients to means2d, conics, opacities and channels.

    It works in as many threads as torch does.
    """
    count = problem.channels.shape[1]
    forward, backward = _compiled(count)
    channels, v_render = problem.channels.numpy(), problem.v_render.contiguous().numpy()

    def run() -> tuple[Tensor, ...]:
        threads = torch.get_num_threads()
        gaussians, starts, ids = _sorted_into_tiles(problem)
        render = np.empty(v_render.shape, np.float32)
        pairs = np.empty(len(starts) - 1, np.int64)
        gradients = np.zeros((threads, len(gaussians), 6 + count), np.float32)

        def work(thread: int) -> None:
            forward(thread, threads, starts, ids, gaussians, channels, render, pairs)
            backward(thread, threads, starts, ids, gaussians, channels, render, v_render, gradients[thread])

        _in_threads(work, threads)
        total = torch.from_numpy(gradients.sum(axis=0) if threads > 1 else gradients[0])
        return torch.from_numpy(render), total[:, :2], total[:, 2:5], total[:, 5], total[:, 6:]

    return run


def count_pairs(problem: Problem) -> tuple[int, int]:
    """How many (tile, Gaussian) pairs there are, and how many (pixel, Gaussian) pairs are composited."""
    forward, _ = _compiled(problem.channels.shape[1])
    gaussians, starts, ids = _sorted_into_tiles(problem)
    render, pairs = np.empty(tuple(problem.v_render.shape), np.float32), np.empty(len(starts) - 1, np.int64)
    forward(0, 1, starts, ids, gaussians, problem.channels.numpy(), render, pairs)
    return len(ids), int(pairs.sum())


def _sorted_into_tiles(problem: Problem) -> tuple[Floats, Ints, Ints]:
    gaussians, order = _records(problem), problem.depths.argsort(stable=True).numpy()
    return gaussians, *_tiles(gaussians, problem.radii.numpy(), order, problem.width, problem.height)


def _records(problem: Problem) -> Floats:
    """(M, 8): mean, conic, opacity, the sigma at which alpha falls below 1/255, and the half extent in y."""
    reach = (problem.opacities / ALPHA_THRESHOLD).log()
    parts = [
        problem.means2d,
        problem.conics,
        problem.opacities[:, None],
        reach[:, None],
        problem.radii[:, 1:],
    ]
    return torch.cat(parts, dim=1).numpy()


def _in_threads(work: Callable[[int], None], threads: int) -> None:
    if threads == 1:
        work(0)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, range(threads)))


@numba.njit(nogil=True, error_model="numpy")
def _tiles(
    gaussians: Floats, radii: NDArray[np.int32], order: Ints, width: int, height: int
) -> tuple[Ints, Ints]:
    """Where each tile's Gaussians start, and which they are, nearest first."""
    columns, rows = (width + TILE - 1) // TILE, (height + TILE - 1) // TILE
    boxes = np.empty((len(gaussians), 4), np.int64)
    starts = np.zeros(columns * rows + 1, np.int64)
    for g in range(len(gaussians)):
        x, y = gaussians[g, 0], gaussians[g, 1]
        boxes[g, 0] = min(max(math.floor((x - radii[g, 0]) / TILE), 0), columns)
        boxes[g, 1] = min(max(math.ceil((x + radii[g, 0]) / TILE), 0), columns)
        boxes[g, 2] = min(max(math.floor((y - radii[g, 1]) / TILE), 0), rows)
        boxes[g, 3] = min(max(math.ceil((y + radii[g, 1]) / TILE), 0), rows)
        for row in range(boxes[g, 2], boxes[g, 3]):
            for column in range(boxes[g, 0], boxes[g, 1]):
                starts[row * columns + column + 1] += 1
    starts = np.cumsum(starts)
    ids, filled = np.empty(starts[-1], np.int64), starts[:-1].copy()
    for g in order:
        for row in range(boxes[g, 2], boxes[g, 3]):
            for column in range(boxes[g, 0], boxes[g, 1]):
                tile = row * columns + column
                ids[filled[tile]] = g
                filled[tile] += 1
    return starts, ids


@numba.njit(nogil=True, error_model="numpy", inline="always")
def _profile(sigma: np.float32) -> np.float32:
    """``exp(-sigma)`` for sigma up to 8, without a call, so that the compiler can vectorise what is around it."""
    x = max(sigma * _MINUS_SIXTEENTH, -_HALF)
    series = _ONE + x * (_ONE + x * (_C2 + x * (_C3 + x * (_C4 + x * (_C5 + x * _C6)))))
    squared = series * series
    squared *= squared
    squared *= squared
    return squared * squared


@functools.cache
def _compiled(count: int) -> tuple[Callable[..., None], Callable[..., None]]:
    """Forward and backward pass with the number of channels compiled in, which is faster than with any number."""

    @numba.njit(nogil=True, error_model="numpy")
    def forward(
        thread: int,
        threads: int,
        starts: Ints,
        ids: Ints,
        gaussians: Floats,
        channels: Floats,
        render: Floats,
        pairs: Ints,
    ) -> None:
        height, width = render.shape[:2]
        columns = (width + TILE - 1) // TILE
        transmittance = np.empty((TILE, TILE), np.float32)
        color = np.empty((TILE, count, TILE), np.float32)
        weights = np.empty(TILE, np.float32)
        for tile in range(thread, len(starts) - 1, threads):
            top, left = tile // columns * TILE, tile % columns * TILE
            bottom, right = min(top + TILE, height), min(left + TILE, width)
            transmittance[:] = _ONE
            color[:] = _ZERO
            composited = 0
            for g in ids[starts[tile] : starts[tile + 1]]:
                mean_x, mean_y, a, b, c, opacity, reach, radius = gaussians[g]
                first = max(int(mean_y - radius) - top, 0)
                last = min(int(mean_y + radius) + 1 - top, bottom - top)
                mean_x -= np.float32(left)
                for row in range(first, last):
                    dy = np.float32(top + row) + _HALF - mean_y
                    before = transmittance[row]
                    reached = 0
                    for column in range(TILE):
                        dx = np.float32(column) + _HALF - mean_x
                        sigma = _HALF * (a * dx * dx + c * dy * dy) + b * dx * dy
                        alpha = min(opacity * _profile(sigma), _MAX_ALPHA)
                        alpha = alpha if (sigma >= _ZERO) & (sigma <= reach) else _ZERO
                        behind = before[column] * (_ONE - alpha)
                        goes_on = behind > _MIN_TRANSMITTANCE
                        weights[column] = alpha * before[column] if goes_on else _ZERO
                        before[column] = behind if goes_on else _ZERO
                    for column in range(right - left):
                        reached += weights[column] > _ZERO
                    composited += reached
                    if reached:
                        for k in range(count):
                            for column in range(TILE):
                                color[row, k, column] += weights[column] * channels[g, k]
            for row in range(bottom - top):
                for column in range(right - left):
                    for k in range(count):
                        render[top + row, left + column, k] = color[row, k, column]
            pairs[tile] = composited

    @numba.njit(nogil=True, error_model="numpy")
    def backward(
        thread: int,
        threads: int,
        starts: Ints,
        ids: Ints,
        gaussians: Floats,
        channels: Floats,
        render: Floats,
        v_render: Floats,
        gradients: Floats,
    ) -> None:
        height, width = render.shape[:2]
        columns = (width + TILE - 1) // TILE
        transmittance = np.empty((TILE, TILE), np.float32)
        # What the Gaussians that are still to come add to the loss.
        rest = np.empty((TILE, TILE), np.float32)
        v_color = np.zeros((TILE, count, TILE), np.float32)
        shown = np.empty(TILE, np.float32)
        weights = np.empty(TILE, np.float32)
        # Column by column, and summed once a Gaussian: to add along a row would be slow.
        sums = np.empty((6 + count, TILE), np.float32)
        for tile in range(thread, len(starts) - 1, threads):
            top, left = tile // columns * TILE, tile % columns * TILE
            bottom, right = min(top + TILE, height), min(left + TILE, width)
            transmittance[:] = _ONE
            rest[:] = _ZERO
            v_color[:] = _ZERO
            for row in range(bottom - top):
                for column in range(right - left):
                    for k in range(count):
                        v_color[row, k, column] = v_render[top + row, left + column, k]
                        rest[row, column] += v_color[row, k, column] * render[top + row, left + column, k]
            for g in ids[starts[tile] : starts[tile + 1]]:
                mean_x, mean_y, a, b, c, opacity, reach, radius = gaussians[g]
                first = max(int(mean_y - radius) - top, 0)
                last = min(int(mean_y + radius) + 1 - top, bottom - top)
                mean_x -= np.float32(left)
                sums[:] = _ZERO
                for row in range(first, last):
                    dy = np.float32(top + row) + _HALF - mean_y
                    before, coming = transmittance[row], rest[row]
                    shown[:] = _ZERO
                    for k in range(count):
                        for column in range(TILE):
                            shown[column] += v_color[row, k, column] * channels[g, k]
                    for column in range(TILE):
                        dx = np.float32(column) + _HALF - mean_x
                        sigma = _HALF * (a * dx * dx + c * dy * dy) + b * dx * dy
                        profile = _profile(sigma)
                        unclamped = opacity * profile
                        alpha = min(unclamped, _MAX_ALPHA)
                        alpha = alpha if (sigma >= _ZERO) & (sigma <= reach) else _ZERO
                        behind = before[column] * (_ONE - alpha)
                        goes_on = behind > _MIN_TRANSMITTANCE
                        weight = alpha * before[column] if goes_on else _ZERO
                        coming[column] -= weight * shown[column]
                        v_alpha = before[column] * shown[column] - coming[column] / (_ONE - alpha)
                        v_alpha = v_alpha if (weight > _ZERO) & (unclamped <= _MAX_ALPHA) else _ZERO
                        v_sigma = -alpha * v_alpha
                        weights[column] = weight
                        before[column] = behind if goes_on else _ZERO
                        sums[0, column] -= v_sigma * (a * dx + b * dy)
                        sums[1, column] -= v_sigma * (b * dx + c * dy)
                        sums[2, column] += v_sigma * _HALF * dx * dx
                        sums[3, column] += v_sigma * dx * dy
                        sums[4, column] += v_sigma * _HALF * dy * dy
                        sums[5, column] += v_alpha * profile
                    for k in range(count):
                        for column in range(TILE):
                            sums[6 + k, column] += weights[column] * v_color[row, k, column]
                for k in range(6 + count):
                    gradients[g, k] += sums[k].sum()

    return forward, backward

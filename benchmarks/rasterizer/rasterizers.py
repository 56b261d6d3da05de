"""The rasterizers that are compared: each does the forward and the backward pass of one problem."""

from collections.abc import Callable
from functools import lru_cache

import torch
from torch import Tensor

from benchmarks.rasterizer.scenes import SCENES, Problem, make_problem, make_scene
from benchmarks.rasterizer.timing import Sample, timed
from egosplat.kernels import library
from egosplat.kernels.raster import composite
from egosplat.rasterize import composite_reference

Run = Callable[[], tuple[Tensor, ...]]
"""Returns the image (H, W, X) and the gradients to means2d, conics, opacities and channels."""


def prepare_kernels(problem: Problem) -> Run:
    """The compiled kernels."""
    leaves = _leaves(problem)
    v_planar = problem.v_render.permute(2, 0, 1)

    def run() -> tuple[Tensor, ...]:
        render = _by_kernels(problem, *leaves)
        return render.detach().permute(1, 2, 0), *torch.autograd.grad(render, leaves, v_planar)

    return run


def prepare_frozen(problem: Problem) -> Run:
    """The compiled kernels where the channels alone are trained; the gradient to these alone."""
    channels = problem.channels.clone().requires_grad_()
    v_planar = problem.v_render.permute(2, 0, 1)

    def run() -> tuple[Tensor, ...]:
        render = _by_kernels(problem, problem.means2d, problem.conics, problem.opacities, channels)
        return render.detach().permute(1, 2, 0), *torch.autograd.grad(render, [channels], v_planar)

    return run


def prepare_torch(problem: Problem) -> Run:
    """The pure-torch reference."""
    leaves = _leaves(problem)

    def run() -> tuple[Tensor, ...]:
        size = (problem.width, problem.height)
        render, _ = composite_reference.composite(*leaves, problem.depths, problem.radii, *size)
        return render.detach(), *torch.autograd.grad(render, leaves, problem.v_render)

    return run


def prepare_numba(problem: Problem) -> Run:
    """The Numba port."""
    from benchmarks.rasterizer import numba_rasterizer

    return numba_rasterizer.prepare(problem)


PREPARE = {
    "kernels": prepare_kernels,
    "frozen": prepare_frozen,
    "torch": prepare_torch,
    "numba": prepare_numba,
}


def sample(name: str, scene: str, channels: int, threads: int) -> Sample:
    """Time one forward and backward pass of a rasterizer in ``PREPARE``."""
    run = _prepared(name, scene, channels)
    return timed(run, threads)


def outputs(name: str, scene: str, channels: int) -> list[Tensor]:
    """What a rasterizer in ``PREPARE`` gives: image and gradients."""
    return [tensor.contiguous() for tensor in _prepared(name, scene, channels)()]


def variant() -> str:
    """The variant of the kernels in this process."""
    return library.variant()


def describe(scene: str) -> dict[str, int]:
    """How much work a scene is."""
    from benchmarks.rasterizer import numba_rasterizer

    gaussians, width, height = SCENES[scene]
    problem = _problem(scene, 3)
    intersections, pairs = numba_rasterizer.count_pairs(problem)
    known = {"gaussians": gaussians, "width": width, "height": height, "visible": len(problem.depths)}
    return known | {"intersections": intersections, "pairs": pairs}


def _leaves(problem: Problem) -> list[Tensor]:
    parts = (problem.means2d, problem.conics, problem.opacities, problem.channels)
    return [part.clone().requires_grad_() for part in parts]


def _by_kernels(
    problem: Problem, means2d: Tensor, conics: Tensor, opacities: Tensor, channels: Tensor
) -> Tensor:
    render, _ = composite(
        means2d,
        conics,
        problem.depths,
        opacities,
        channels,
        spreads=None,
        radii=problem.radii,
        background=None,
        width=problem.width,
        height=problem.height,
    )
    return render


@lru_cache(maxsize=1)
def _prepared(name: str, scene: str, channels: int) -> Run:
    return PREPARE[name](_problem(scene, channels))


@lru_cache(maxsize=1)
def _problem(scene: str, channels: int) -> Problem:
    return make_problem(make_scene(*SCENES[scene]), channels)

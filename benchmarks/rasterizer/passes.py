"""Forward and backward pass of one problem, by the compiled kernels and by the PyTorch reference."""

from collections.abc import Callable
from functools import lru_cache

import torch
from torch import Tensor

from benchmarks.rasterizer.scenes import SCENES, Problem, make_problem, make_scene
from benchmarks.rasterizer.timing import sample
from egosplat.rasterize.kernels import library
from egosplat.rasterize.kernels.raster import composite
from egosplat.rasterize.reference.projection import Projected
from egosplat.rasterize.reference.rasterizer import composite as composite_in_torch

# Returns the image (H, W, X), then the gradients to means2d, conics, opacities and channels.
Run = Callable[[], tuple[Tensor, ...]]


def prepare_kernels(problem: Problem) -> Run:
    """Both passes by the compiled kernels."""
    leaves = _leaves(problem)
    v_planar = problem.v_render.permute(2, 0, 1)

    def run() -> tuple[Tensor, ...]:
        means2d, conics, opacities, channels = leaves
        render, _ = composite(
            means2d,
            conics,
            problem.depths,
            opacities,
            channels,
            variances_y=None,
            radii=problem.radii,
            background=None,
            width=problem.width,
            height=problem.height,
        )
        return render.detach().permute(1, 2, 0), *torch.autograd.grad(render, leaves, v_planar)

    return run


def prepare_torch(problem: Problem) -> Run:
    """Both passes by the PyTorch reference."""
    means2d, conics, opacities, channels = leaves = _leaves(problem)
    seen = Projected(means2d, conics, problem.depths, problem.radii, opacities)

    def run() -> tuple[Tensor, ...]:
        render, _ = composite_in_torch(seen, channels, problem.width, problem.height)
        return render.detach(), *torch.autograd.grad(render, leaves, problem.v_render)

    return run


def sample_pass(kind: str, scene: str, channels: int) -> float:
    """Processor time of both passes [ms] of ``kernels`` or ``torch`` on a scene."""
    return sample(_prepared(kind, scene, channels))


def outputs(kind: str, scene: str, channels: int) -> list[Tensor]:
    """Image and gradients of ``kernels`` or ``torch`` on a scene."""
    return [tensor.contiguous() for tensor in _prepared(kind, scene, channels)()]


def variant() -> str:
    """The variant of the kernels in this process."""
    return library.variant()


def _leaves(problem: Problem) -> list[Tensor]:
    parts = (problem.means2d, problem.conics, problem.opacities, problem.channels)
    return [part.clone().requires_grad_() for part in parts]


@lru_cache(maxsize=1)
def _prepared(kind: str, scene: str, channels: int) -> Run:
    prepare = {"kernels": prepare_kernels, "torch": prepare_torch}[kind]
    return prepare(_problem(scene, channels))


@lru_cache(maxsize=1)
def _problem(scene: str, channels: int) -> Problem:
    return make_problem(make_scene(*SCENES[scene]), channels)

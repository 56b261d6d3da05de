"""Rasterization on a GPU with projection: egosplat's backends, and gsplat called directly."""

import time
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from benchmarks.common import markdown
from benchmarks.rasterizer.scenes import EPS2D, NEAR_PLANE, SCENES, Scene, channels, make_scene
from egosplat.rasterize.api import rasterization
from egosplat.rasterize.cuda import load_gsplat

ROUNDS = 50

Call = Callable[[], tuple[Tensor, ...]]


def table(channel_counts: tuple[int, ...]) -> str:
    """Best wall time of a forward and backward pass on all scenes, as Markdown.

    Raises:
        UserError: there is no CUDA device, or no gsplat.
    """
    gsplat = load_gsplat()
    rows = []
    for name, size in SCENES.items():
        scene = make_scene(*size)
        for count in channel_counts:
            calls = {
                "gsplat": prepare(scene, count, "cuda", gsplat.rasterization, packed=False),
                "egosplat, cuda": prepare(scene, count, "cuda", rasterization, backend="cuda"),
                "egosplat, cpu": prepare(scene, count, "cpu", rasterization, backend="cpu"),
            }
            # The calls take turns, so that a busy moment affects all of them.
            times = [[_wall_ms(run) for run in calls.values()] for _ in range(ROUNDS)]
            rows.append([name, count, *(f"{min(own):.2f}" for own in zip(*times, strict=True))])
    return markdown(["scene", "channels", "gsplat [ms]", "egosplat, cuda [ms]", "egosplat, cpu [ms]"], rows)


def prepare(scene: Scene, count: int, device: str, function: Callable[..., Any], **options: Any) -> Call:
    """A function that renders the first camera and returns the gradients to all Gaussians."""
    parts = (scene.means, scene.quats, scene.scales, scene.opacities, channels(scene, count))
    leaves = [part.to(device, copy=True).requires_grad_() for part in parts]
    cameras = [camera.to(device) for camera in (scene.viewmats[:1], scene.K[None])]
    v_render = torch.ones(1, scene.height, scene.width, count, device=device)
    limits = {"near_plane": NEAR_PLANE, "eps2d": EPS2D}

    def run() -> tuple[Tensor, ...]:
        render, _, _ = function(*leaves, *cameras, scene.width, scene.height, **limits, **options)
        return torch.autograd.grad(render, leaves, v_render)

    return run


def _wall_ms(run: Call) -> float:
    torch.cuda.synchronize()
    start = time.perf_counter()
    run()
    torch.cuda.synchronize()
    return 1e3 * (time.perf_counter() - start)

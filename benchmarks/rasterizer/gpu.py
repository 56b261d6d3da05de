"""The whole rasterization on a GPU: egosplat's backend, and gsplat called directly."""

import time
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from benchmarks.rasterizer.scenes import EPS2D, NEAR_PLANE, SCENES, Scene, channels, make_scene
from egosplat.rasterize.api import rasterization
from egosplat.rasterize.cuda import load_gsplat

ROUNDS = 50

Call = Callable[[], tuple[Tensor, ...]]


def compare(channel_counts: tuple[int, ...]) -> list[dict[str, Any]]:
    """Best time of a forward and backward pass, projection included, for all scenes [ms].

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
            times: dict[str, list[float]] = {call: [] for call in calls}
            for round_ in range(ROUNDS + 1):
                for call, run in calls.items():
                    elapsed = _wall_ms(run)
                    if round_:
                        times[call].append(elapsed)
            rows += [
                {"scene": name, "channels": count, "rasterizer": call, "ms": min(elapsed)}
                for call, elapsed in times.items()
            ]
    return rows


def table(rows: list[dict[str, Any]]) -> str:
    """The rows as text."""
    return "Rasterization with projection, forward and backward pass [best ms on the clock]\n" + "\n".join(
        f"{row['scene']}, {row['channels']:2} channels  {row['rasterizer']:14} {row['ms']:9.2f}"
        for row in rows
    )


def prepare(scene: Scene, count: int, device: str, function: Callable[..., Any], **options: Any) -> Call:
    """A function that renders the scene's first camera and returns the gradients to all of the Gaussians."""
    parts = (scene.means, scene.quats, scene.scales, scene.opacities, channels(scene, count))
    leaves = [part.to(device, copy=True).requires_grad_() for part in parts]
    cameras = [camera.to(device) for camera in (scene.viewmats[:1], scene.K[None])]
    v_render = torch.ones(1, scene.height, scene.width, count, device=device)

    def run() -> tuple[Tensor, ...]:
        size = (scene.width, scene.height)
        limits = {"near_plane": NEAR_PLANE, "eps2d": EPS2D}
        render, _, _ = function(*leaves, *cameras, *size, **limits, **options)
        return torch.autograd.grad(render, leaves, v_render)

    return run


def _wall_ms(run: Call) -> float:
    torch.cuda.synchronize()
    start = time.perf_counter()
    run()
    torch.cuda.synchronize()
    return 1e3 * (time.perf_counter() - start)

"""Render 3D Gaussians with the backend that suits the tensors, and choose device and backend for training."""

from collections.abc import Callable
from functools import cache
from typing import Any

import torch
from torch import Tensor

from egosplat.errors import UserError
from egosplat.progress import log
from egosplat.rasterize.contract import Arguments, Render, check
from egosplat.rasterize.cuda import load_gsplat
from egosplat.rasterize.kernels import library

BACKENDS = ("auto", "cuda", "cpu", "reference")


def rasterization(*given: Any, backend: str = "auto", **options: Any) -> Render:
    """Render 3D Gaussians (Kerbl et al. 2023) into pinhole cameras, differentiably.

    Names and semantics are those of gsplat 1.5.3's ``rasterization``. All tensors share one device and one
    dtype, float32 or float64 (the backends cuda and cpu take float32 only). All of them except ``Ks`` get
    gradients. A Gaussian with a non-finite number or a quaternion of length 0 is culled, and its gradient
    is zero.

    Args:
        means: (N, 3) centers in the world [m].
        quats: (N, 4) wxyz, of any length.
        scales: (N, 3) standard deviations [m].
        opacities: (N,) in [0, 1].
        colors: (N, D), or with ``sh_degree`` (N, K, 3) coefficients, K = 1, 4, 9 or 16.
        viewmats: (C, 4, 4) world_to_camera, OpenCV axes.
        Ks: (C, 3, 3) intrinsics without skew [px]; pixel centers lie at integer + 0.5.
        width, height: image size [px].
        near_plane, far_plane: Gaussians whose center has a camera z outside this range are culled [m].
        radius_clip: Gaussians with both radii at most this are culled [px].
        eps2d: added to both variances of a Gaussian in the image [px²].
        sh_degree: degree to evaluate, at most that of K; the color is ``max(SH + 0.5, 0)``. None: ``colors``
            are colors.
        features: (N, F) channels, appended to the colors in the same pass.
        backgrounds: (C, D + F), visible where alpha is less than 1.
        render_mode: ``RGB`` colors and features, ``D`` accumulated camera z [m], ``ED`` accumulated camera z
            divided by alpha, ``RGB+D`` and ``RGB+ED`` with the depth as last channel.
        rasterize_mode: ``classic``, or ``antialiased``: opacities are lowered to compensate for the blur of
            ``eps2d`` (Mip-Splatting, Yu et al. 2024).
        backend: ``cuda`` (gsplat), ``cpu`` (the compiled kernels), ``reference`` (plain PyTorch, slow), or
            ``auto``: reference for float64, else cuda for tensors on a CUDA device, else cpu if the
            kernels are compiled, else reference with one warning per process.

    Returns:
        (C, H, W, X) images; (C, H, W, 1) accumulated alpha; and meta: ``means2d`` (C, N, 2) px, in the
        autograd graph, ``radii`` (C, N, 2) int32 px, (0, 0) where culled, ``depths`` (C, N) m, ``conics``
        (C, N, 3) 1/px², ``opacities`` (C, N), compensated in antialiased mode, ``width``, ``height``,
        ``n_cameras``. Rows of culled Gaussians are undefined except for the radii.

    Raises:
        ValueError: an argument is not as described. The numbers of cameras on a GPU are not read.
        UserError: the chosen backend cannot run here.
    """
    arguments = Arguments(*given, **options)
    check(arguments)
    return renderer(backend, arguments.means)(arguments)


def renderer(name: str, means: Tensor) -> Callable[[Arguments], Render]:
    """Return the function of a backend; it is imported on first use, because each backend has its own dependencies."""
    name = chosen_backend(name, means)
    if name == "cuda":
        from egosplat.rasterize.cuda import rasterization as chosen
    elif name == "cpu":
        from egosplat.rasterize.cpu import rasterization as chosen
    else:
        from egosplat.rasterize.reference.rasterizer import rasterization as chosen
    return chosen


def chosen_backend(name: str, means: Tensor) -> str:
    """Return the name of a backend, with ``auto`` resolved for the means (ValueError: there is no such
    backend)."""
    if name not in BACKENDS:
        raise ValueError(f"backend is {name!r}, not one of {', '.join(BACKENDS)}")
    return _choose(means) if name == "auto" else name


def _choose(means: Tensor) -> str:
    # Only the reference computes in float64.
    if means.dtype != torch.float32:
        return "reference"
    if means.is_cuda:
        return "cuda"
    if means.device.type != "cpu":
        _warn_slow(f"none for {means.device.type}")
        return "reference"
    # Compiled but unusable kernels are an error for the user to fix. Fall back only if none are compiled.
    if library.is_compiled():
        return "cpu"
    _warn_slow(library.why_not())
    return "reference"


@cache
def _warn_slow(why_not: str | None) -> None:
    log(f"warning: rendering in plain PyTorch, which is slow. Compiled kernels: {why_not}")


def training_device(backend: str) -> torch.device:
    """Return the device for a rasterization backend. gsplat is loaded here, before a stage reads anything.
    ``auto`` selects the GPU if there is one and gsplat loads; if it does not load, the reason is logged.
    UserError: the backend is ``cuda``, and the GPU or its gsplat cannot run on this machine."""
    if backend == "cuda":
        load_gsplat()
        return torch.device("cuda")
    # A GPU without gsplat cannot render.
    if backend == "auto" and torch.cuda.is_available():
        try:
            load_gsplat()
            return torch.device("cuda")
        except UserError as error:
            log(f"rendering on the CPU, which is slow. {error}")
    return torch.device("cpu")


def rasterizer_used(backend: str, device: torch.device) -> str:
    """Name the rasterizer for the artifact: ``cuda``, ``cpu`` with the kernel variant, or ``reference``."""
    if device.type == "cuda":
        return f"cuda ({torch.cuda.get_device_name(device)})"
    if backend == "reference" or not library.is_compiled():
        return "reference"
    return f"cpu ({library.variant()})"

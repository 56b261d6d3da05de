"""Render 3D Gaussians, and sum images over them, with the backend that suits the tensors."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import torch
from torch import Tensor
from torch.nn.functional import embedding_bag

from egosplat.kernels import library
from egosplat.progress import log
from egosplat.rasterize.contract import Arguments, Render, check

BACKENDS = ("auto", "cuda", "cpu", "reference")


def rasterization(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colors: Tensor,
    viewmats: Tensor,
    Ks: Tensor,
    width: int,
    height: int,
    *,
    near_plane: float = 0.1,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    eps2d: float = 0.3,
    sh_degree: int | None = None,
    features: Tensor | None = None,
    backgrounds: Tensor | None = None,
    render_mode: str = "RGB",
    rasterize_mode: str = "classic",
    backend: str = "auto",
) -> Render:
    """Render 3D Gaussians (Kerbl et al. 2023) into pinhole cameras, differentiably.

    Names and semantics are those of gsplat 1.5.3's ``rasterization``. All tensors share one device and one
    dtype, float32 or float64 (the backends cuda and cpu take float32 only). All of them except ``Ks`` get
    gradients. A Gaussian with a non-finite number or a quaternion of length 0 is culled, and its gradient
    is zero.

    Args:
        means: (N, 3) centres in the world [m].
        quats: (N, 4) wxyz, of any length.
        scales: (N, 3) standard deviations [m].
        opacities: (N,) in [0, 1].
        colors: (N, D), or with ``sh_degree`` (N, K, 3) coefficients, K = 1, 4, 9 or 16.
        viewmats: (C, 4, 4) world_to_camera, OpenCV axes.
        Ks: (C, 3, 3) intrinsics without skew [px]; pixel centres lie at integer + 0.5.
        width, height: image size [px].
        near_plane, far_plane: Gaussians whose centre has a camera z outside this range are culled [m].
        radius_clip: Gaussians with both radii at most this are culled [px].
        eps2d: added to both variances of a Gaussian in the image [px²].
        sh_degree: degree to evaluate, at most that of K; the colour is ``max(SH + 0.5, 0)``. None: ``colors``
            are colours.
        features: (N, F) channels, appended to the colours in the same pass.
        backgrounds: (C, D + F), visible where alpha is less than 1.
        render_mode: ``RGB`` colours and features, ``D`` accumulated camera z [m], ``ED`` accumulated camera z
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
    # Nothing else is local yet: these are exactly the arguments.
    given = dict(locals())
    del given["backend"]
    arguments = Arguments(**given)
    check(arguments)
    return _backend(backend, means)(arguments)


def sum_over_pixels(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    image: Tensor,
    viewmat: Tensor,
    K: Tensor,
    *,
    near_plane: float = 0.1,
    rasterize_mode: str = "classic",
    backend: str = "auto",
) -> Tensor:
    """Sum an image over each Gaussian's compositing weights: the transposed map of ``rasterization``.

    The backend cpu renders no image for it; the others take the gradient of one. Not differentiable.

    Args:
        means, quats, scales, opacities, near_plane, rasterize_mode, backend: as in ``rasterization``.
        image: (H, W, X) of the same dtype and device.
        viewmat: (4, 4) world_to_camera; K: (3, 3) intrinsics [px].

    Returns:
        (N, X).

    Raises: as ``rasterization``.
    """
    if image.ndim != 3 or (image.dtype, image.device) != (means.dtype, means.device):
        raise ValueError(
            f"image is {tuple(image.shape)} {image.dtype} on {image.device}; (H, W, X) like means is needed"
        )
    height, width, channels = image.shape
    nothing = means.new_zeros(1, channels).expand(len(means), -1)
    geometry = means, quats, scales, opacities, nothing
    arguments = _one_camera(geometry, viewmat, K, width, height, near_plane, rasterize_mode)
    if _name(backend, means) == "cpu":
        from egosplat.rasterize.cpu import sum_over_pixels as chosen

        return chosen(arguments, image)
    # Rendering is linear in the values, so its gradient is the transposed map, at any values.
    values = nothing.clone().requires_grad_()
    with torch.enable_grad():
        images, _, _ = _backend(backend, means)(replace(arguments, colors=values))
    return torch.autograd.grad(images, values, image[None])[0]


def sparse_values(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    begin: Tensor,
    channel: Tensor,
    value: Tensor,
    channels: int,
    viewmat: Tensor,
    K: Tensor,
    width: int,
    height: int,
    *,
    near_plane: float = 0.1,
    rasterize_mode: str = "classic",
    backend: str = "auto",
) -> Tensor:
    """Render values of which a Gaussian has few that are not 0, on background 0. Not differentiable.

    The backend cpu takes time by their number; the others render the dense values.

    Args:
        means, quats, scales, opacities, near_plane, rasterize_mode, backend: as in ``rasterization``.
        begin, channel, value: (N + 1,) int64, (M,) int64 and (M,) of the dtype of means, the rows of a sparse (N, X)
            matrix: Gaussian i has the values ``begin[i]`` to ``begin[i + 1]``, of the channels that are named there.
        channels: X.
        viewmat: (4, 4) world_to_camera; K: (3, 3) intrinsics [px].

    Returns:
        (X, H, W).

    Raises: as ``rasterization``; and ValueError if the rows are not those of a matrix of this size.
    """
    count = len(means)
    fits = len(begin) == count + 1 and int(begin[0]) == 0 and int(begin[-1]) == len(channel) == len(value)
    fits = fits and value.dtype == means.dtype
    if not fits or (begin.diff() < 0).any() or ((channel < 0) | (channel >= channels)).any():
        raise ValueError(f"the values are not the rows of a {means.dtype} matrix of {count} x {channels}")
    nothing = means.new_zeros(1, channels).expand(count, -1)
    geometry = means, quats, scales, opacities, nothing
    arguments = _one_camera(geometry, viewmat, K, width, height, near_plane, rasterize_mode)
    if _name(backend, means) == "cpu":
        from egosplat.rasterize.cpu import sparse_values as chosen

        return chosen(arguments, begin, channel, value, channels)
    dense = means.new_zeros(count, channels)
    dense.index_put_((torch.repeat_interleave(begin.diff()), channel), value, accumulate=True)
    with torch.no_grad():
        images, _, _ = _backend(backend, means)(replace(arguments, colors=dense))
    return images[0].permute(2, 0, 1)


def pixel_renderer(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    pixels: Tensor,
    viewmat: Tensor,
    K: Tensor,
    width: int,
    height: int,
    *,
    near_plane: float = 0.1,
    rasterize_mode: str = "classic",
    backend: str = "auto",
) -> Callable[[Tensor], Tensor]:
    """Prepare to render single pixels: ``rasterization`` without the rest of the image.

    The backend cpu lists what each pixel shows once, so that a render takes time by its pixels and no longer by the
    image; the others render the whole image.

    Args:
        means, quats, scales, opacities, near_plane, rasterize_mode, backend: as in ``rasterization``.
        pixels: (P, 2) integers, column and row, on the CPU.
        viewmat: (4, 4) world_to_camera; K: (3, 3) intrinsics [px].

    Returns:
        A function of (N, X) values that gives (P, X) on background 0, differentiable by the values alone.

    Raises: as ``rasterization``; and ValueError if a pixel lies outside the image.
    """
    unused = means.new_zeros(1, 1).expand(len(means), -1)
    geometry = means, quats, scales, opacities, unused
    arguments = _one_camera(geometry, viewmat, K, width, height, near_plane, rasterize_mode)
    if _name(backend, means) == "cpu":
        from egosplat.rasterize.cpu import pixel_weights

        begin, gaussians, weights = pixel_weights(arguments, pixels)
        options = {"mode": "sum", "include_last_offset": True, "per_sample_weights": weights}
        return lambda values: embedding_bag(gaussians, values, begin, **options)
    columns, rows = pixels.to(means.device).unbind(1)
    chosen = _backend(backend, means)
    return lambda values: chosen(replace(arguments, colors=values))[0][0, rows, columns]


def pixel_lists(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    pixels: Tensor,
    viewmat: Tensor,
    K: Tensor,
    width: int,
    height: int,
    *,
    near_plane: float = 0.1,
    rasterize_mode: str = "classic",
    backend: str = "auto",
) -> tuple[Tensor, Tensor, Tensor]:
    """List what single pixels show.

    The compiled kernels make the list on the CPU also for the backend cuda, because gsplat has none. The reference
    renders every Gaussian by itself, so it suits small scenes.

    Args:
        means, quats, scales, opacities, near_plane, rasterize_mode, backend: as in ``rasterization``.
        pixels: (P, 2) integers, column and row, on the CPU.
        viewmat: (4, 4) world_to_camera; K: (3, 3) intrinsics [px].

    Returns:
        On the CPU: begin (P + 1,) int64, where each pixel's list begins, and the end; Gaussians (M,) int64, nearest
        first; and their weights (M,), alpha times transmittance.

    Raises: as ``rasterization``; and ValueError if a pixel lies outside the image.
    """
    name, arguments = _on_cpu(
        means, quats, scales, opacities, viewmat, K, width, height, near_plane, rasterize_mode, backend
    )
    if name != "reference":
        from egosplat.rasterize.cpu import pixel_weights

        return pixel_weights(arguments, pixels)
    return _reference_lists(arguments, pixels)


def own_weights(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    pixels: Tensor,
    viewmat: Tensor,
    K: Tensor,
    width: int,
    height: int,
    *,
    near_plane: float = 0.1,
    rasterize_mode: str = "classic",
    backend: str = "auto",
) -> Tensor:
    """Find the weight of each Gaussian at one pixel of its own, on the CPU as ``pixel_lists`` does.

    Args:
        means, quats, scales, opacities, viewmat, K, near_plane, rasterize_mode, backend: as in ``pixel_lists``.
        pixels: (N, 2) integers, column and row, on the CPU; outside the image, such as -1, for none.

    Returns:
        (N,) on the CPU, alpha times transmittance; 0 where the pixel ends before the Gaussian, or there is none.

    Raises: as ``rasterization``; and ValueError if the pixels are not (N, 2).
    """
    if pixels.shape != (len(means), 2):
        raise ValueError(f"pixels are {tuple(pixels.shape)}; ({len(means)}, 2) is needed")
    name, arguments = _on_cpu(
        means, quats, scales, opacities, viewmat, K, width, height, near_plane, rasterize_mode, backend
    )
    if name != "reference":
        from egosplat.rasterize.cpu import own_weights as compiled

        return compiled(arguments, pixels)
    inside = ((pixels >= 0) & (pixels < torch.tensor([width, height]))).all(dim=1).nonzero()[:, 0]
    begin, ids, weights = _reference_lists(arguments, pixels[inside])
    owner = inside[torch.repeat_interleave(begin.diff())]
    own = ids == owner
    return weights.new_zeros(len(pixels)).index_put((owner[own],), weights[own])


def _one_camera(
    gaussians: tuple[Tensor, ...],
    viewmat: Tensor,
    K: Tensor,
    width: int,
    height: int,
    near_plane: float,
    rasterize_mode: str,
) -> Arguments:
    """The checked arguments of one camera; ``gaussians`` are means, quaternions, scales, opacities and colours."""
    arguments = Arguments(
        *gaussians,
        viewmat[None],
        K[None],
        width,
        height,
        near_plane=near_plane,
        rasterize_mode=rasterize_mode,
    )
    check(arguments)
    return arguments


def _on_cpu(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    viewmat: Tensor,
    K: Tensor,
    width: int,
    height: int,
    near_plane: float,
    rasterize_mode: str,
    backend: str,
) -> tuple[str, Arguments]:
    """Name of the backend, and the checked arguments of one camera on the CPU."""
    name = _name(backend, means)
    on_cpu = [one.cpu() for one in (means, quats, scales, opacities)]
    # The reference lists what the pixels of one image for each Gaussian show.
    colors = torch.eye(len(means), dtype=means.dtype) if name == "reference" else on_cpu[3][:, None]
    view = viewmat.cpu(), K.cpu(), width, height, near_plane, rasterize_mode
    return name, _one_camera((*on_cpu, colors), *view)


def _reference_lists(arguments: Arguments, pixels: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    images, _, meta = _backend("reference", arguments.means)(arguments)
    order = meta["depths"][0].argsort(stable=True)
    shown = images[0, pixels[:, 1], pixels[:, 0]][:, order]
    pixel, place = shown.nonzero(as_tuple=True)
    counts = torch.bincount(pixel, minlength=len(pixels))
    return torch.cat([counts.new_zeros(1), counts.cumsum(0)]), order[place], shown[pixel, place]


def _backend(name: str, means: Tensor) -> Callable[[Arguments], Render]:
    """The function of a backend, imported on first use, because each has its own dependencies."""
    name = _name(name, means)
    if name == "cuda":
        from egosplat.rasterize.cuda import rasterization as chosen
    elif name == "cpu":
        from egosplat.rasterize.cpu import rasterization as chosen
    else:
        from egosplat.rasterize.reference.rasterizer import rasterization as chosen
    return chosen


def _name(name: str, means: Tensor) -> str:
    """Name of a backend, that of ``auto`` resolved."""
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
    why_not = None if library.is_compiled() else library.why_not()
    if why_not is None:
        return "cpu"
    _warn_slow(why_not)
    return "reference"


@cache
def _warn_slow(why_not: str) -> None:
    log(f"warning: rendering in plain PyTorch, which is slow. Compiled kernels: {why_not}")

"""Differentiable projection and compositing with the compiled kernels. float32 on the CPU.

Images are planar, (channels, height, width), as the kernels write them.
"""

import ctypes
import weakref
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from egosplat.rasterize.contract import Arguments
from egosplat.rasterize.kernels.library import address, function, plain


def project(
    a: Arguments, camera: int, sh: Tensor | None, features: Tensor | None
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Project Gaussians into the image of one of the cameras and evaluate their channels for this view.

    Args:
        sh: (N, K, 3), to evaluate up to ``a.sh_degree``; features: (N, F) channels to keep; each may be None.

    Returns:
        means2d (N, 2), conics (N, 3), depths (N,), opacities (N,), channels (N, X), variances_y (N,) and radii
        (N, 2) int32; all 0 where culled. The X channels are color, features and depth, those that exist.
    """
    stored, kept = (0 if each is None else each.shape[1] for each in (sh, features))
    coefficients = (a.sh_degree + 1) ** 2 if sh is not None and a.sh_degree is not None else 0
    flags = int(a.shows_depth), a.width, a.height, int(a.antialiased)
    layout = (len(a.means), stored, coefficients, kept, *flags)
    intrinsics = a.Ks[camera][[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    settings = (*intrinsics, a.near_plane, a.far_plane, a.radius_clip, a.eps2d)
    gaussians = (a.means, a.quats, a.scales, a.opacities, sh, features)
    return _Project.apply(*gaussians, a.viewmats[camera], layout, settings)


def composite(
    means2d: Tensor,
    conics: Tensor,
    depths: Tensor,
    opacities: Tensor,
    channels: Tensor,
    variances_y: Tensor | None,
    radii: Tensor,
    background: Tensor | None,
    width: int,
    height: int,
) -> tuple[Tensor, Tensor]:
    """Composite projected Gaussians, nearest first.

    Args:
        means2d: (N, 2) [px]; conics: (N, 3) [1/px²]; depths: (N,), used for the order only; opacities: (N,).
        channels: (N, X).
        variances_y: (N,) variance in y of each Gaussian in the image [px²]; None to compute it from the conics,
            which is inexact for elongated Gaussians. It gets no gradient.
        radii: (N, 2) int32, 0 where culled.
        background: (X,) or None for zeros.

    Returns:
        (X, height, width) and alpha (height, width).
    """
    return _Composite.apply(
        means2d, conics, depths, opacities, channels, variances_y, radii, background, width, height
    )


class _Project(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> tuple[Tensor, ...]:
        *tensors, layout, settings = arguments
        means, quats, scales, opacities, sh, features, viewmat = (plain(tensor) for tensor in tensors)
        count, _, coefficients, kept, depth, *_ = layout
        channels = 3 * bool(coefficients) + kept + depth
        sizes = ((count, 2), (count, 3), (count,), (count,), (count, channels))
        outputs = [torch.empty(size) for size in sizes]
        variances_y, radii = torch.empty(count), torch.empty(count, 2, dtype=torch.int32)
        pose = viewmat.double()
        numbers = (*pose[:3, :3].flatten().tolist(), *pose[:3, 3].tolist(), *settings)
        camera = (ctypes.c_double * len(numbers))(*numbers)
        inputs = (means, quats, scales, opacities, sh, features)
        kernel = function("project_forward", 9 * "i" + "c" + 13 * "p")
        arrays = (*inputs, *outputs, variances_y, radii)
        kernel(*layout, torch.get_num_threads(), camera, *map(address, arrays))
        ctx.layout, ctx.camera = layout, camera
        ctx.save_for_backward(means, quats, scales, opacities, sh, radii, outputs[-1])
        ctx.mark_non_differentiable(variances_y, radii)
        return (*outputs, variances_y, radii)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        means, quats, scales, opacities, sh, radii, channels = ctx.saved_tensors
        needed = ctx.needs_input_grad
        geometry = any(needed[:4]) or needed[6]
        results = [
            torch.empty_like(value) if geometry else None for value in (means, quats, scales, opacities)
        ]
        results.append(torch.empty_like(sh) if needed[4] else None)
        results.append(torch.empty(len(means), ctx.layout[3]) if needed[5] else None)
        pose = torch.zeros(12, dtype=torch.float64) if needed[6] else None
        given = [plain(gradient) for gradient in gradients[:5]]
        arrays = (means, quats, scales, opacities, sh, radii, channels, *given, *results, pose)
        kernel = function("project_backward", 9 * "i" + "c" + 19 * "p")
        kernel(*ctx.layout, torch.get_num_threads(), ctx.camera, *map(address, arrays))
        if pose is None:
            return (*results, None, None, None)
        v_viewmat = torch.zeros(4, 4)
        v_viewmat[:3, :3], v_viewmat[:3, 3] = pose[:9].reshape(3, 3), pose[9:]
        return (*results, v_viewmat, None, None)


class _Composite(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> tuple[Tensor, Tensor]:
        *tensors, width, height = arguments
        means2d, conics, depths, opacities, channels, variances_y, radii, background = map(plain, tensors)
        render, alpha = torch.empty(channels.shape[1], height, width), torch.empty(height, width)
        inputs = (means2d, conics, variances_y, opacities, channels, depths, radii, background, render, alpha)
        sizes = (len(means2d), channels.shape[1], width, height, torch.get_num_threads())
        handle = function("raster_forward", 5 * "i" + 10 * "p", "p")(*sizes, *map(address, inputs))
        ctx.raster = _Raster(handle)
        ctx.save_for_backward(conics, channels, render, alpha)
        # A missing gradient of alpha arrives as None, which saves the kernel a plane of zeros.
        ctx.set_materialize_grads(False)
        return render, alpha

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, v_render: Tensor | None, v_alpha: Tensor | None) -> tuple[Tensor | None, ...]:
        conics, channels, render, alpha = ctx.saved_tensors
        needed = ctx.needs_input_grad
        v_render = torch.zeros_like(render) if v_render is None else plain(v_render)
        count = len(conics)
        # With a frozen geometry the kernel skips its derivatives and sums those of the channels only.
        geometry = needed[0] or needed[1] or needed[3]
        sizes = ((count, 2), (count, 3), (count,)) if geometry else ()
        results = [torch.zeros(size) for size in sizes] or [None] * 3
        v_channels = torch.zeros_like(channels)
        inputs = (conics, render, alpha, v_render, plain(v_alpha), *results, v_channels)
        kernel = function("raster_backward", "pi" + 9 * "p")
        kernel(ctx.raster.handle, torch.get_num_threads(), *map(address, inputs))
        v_means2d, v_conics, v_opacities = results
        v_background = ((1.0 - alpha) * v_render).sum(dim=(1, 2)) if needed[7] else None
        return v_means2d, v_conics, None, v_opacities, v_channels, None, None, v_background, None, None


class _Raster:
    """Owns the kernel's memory between the forward and the backward pass of compositing."""

    def __init__(self, handle: int) -> None:
        self.handle = handle
        weakref.finalize(self, function("raster_free", "p"), handle)

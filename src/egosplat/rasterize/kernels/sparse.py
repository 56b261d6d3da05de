"""Compositing of sparse values, with the compiled kernels. float32 on the CPU."""

import ctypes
import functools
from typing import Any

import torch
from torch import Tensor

from egosplat.rasterize.kernels import library
from egosplat.rasterize.kernels.arrays import address, plain


def composite_sparse(
    means2d: Tensor,
    conics: Tensor,
    depths: Tensor,
    opacities: Tensor,
    variances_y: Tensor,
    radii: Tensor,
    begin: Tensor,
    channel: Tensor,
    value: Tensor,
    channels: int,
    width: int,
    height: int,
) -> Tensor:
    """Composite values of which a Gaussian has few that are not 0, on background 0. Not differentiable.

    Args:
        means2d, conics, depths, opacities, variances_y, radii: as ``kernels.raster.project`` returns them.
        begin, channel, value: (N + 1,) int64, (M,) int64 and (M,) float32, the rows of a sparse (N, X) matrix: Gaussian i has
            the values ``begin[i]`` to ``begin[i + 1]``, of the channels that are named there. The caller checks them.
        channels: X.
        width, height: image size [px].

    Returns:
        (X, height, width), what ``kernels.raster.composite`` renders of the dense values.
    """
    given = (means2d, conics, variances_y, opacities, depths, radii, begin.long(), channel.long(), value)
    # The names keep copies alive during the call.
    arrays = [*map(plain, given)]
    render = torch.zeros(channels, height, width)
    addresses = map(address, (*arrays, render))
    _function()(len(means2d), width, height, torch.get_num_threads(), *addresses)
    return render


@functools.cache
def _function() -> Any:
    function = library.load().egosplat_sparse_render
    function.argtypes = [*[ctypes.c_int] * 4, *[ctypes.c_void_p] * 10]
    function.restype = None
    return function

"""What projected Gaussians show without a rendered image: the functions of ``rasterize.view`` with the compiled kernels, in float32
on the CPU."""

from typing import NamedTuple

import torch
from torch import Tensor

from egosplat.rasterize.kernels.library import address, function, plain

# Gaussians that a pixel shows, of a first guess; a scene with more takes a second call.
_USUAL = 48


class Projected(NamedTuple):
    """Gaussians in one image, each as ``kernels.raster.project`` returns it, without channels."""

    means2d: Tensor
    conics: Tensor
    depths: Tensor
    opacities: Tensor
    variances_y: Tensor
    radii: Tensor
    width: int
    height: int

    def arrays(self) -> list[Tensor | None]:
        """Contiguous copies in the kernels' order. Whoever calls a kernel keeps them until it returns."""
        order = (self.means2d, self.conics, self.variances_y, self.opacities, self.depths, self.radii)
        return [*map(plain, order)]

    def sizes(self) -> tuple[int, int, int, int]:
        """Number of Gaussians, size of the image, number of threads."""
        return len(self.means2d), self.width, self.height, torch.get_num_threads()


def sum_pixels(projected: Projected, image: Tensor) -> Tensor:
    """``view.sum_over_pixels`` of an (X, H, W) image: to the bit the gradient of ``composite`` by its channels, where ``image``
    is that of its render."""
    channels, height, width = image.shape
    sums = torch.zeros(len(projected.means2d), channels)
    arrays = [*projected.arrays(), plain(image), sums]
    sizes = (len(sums), channels, width, height, torch.get_num_threads())
    function("raster_sum", 5 * "i" + 8 * "p")(*sizes, *map(address, arrays))
    return sums


def composite_sparse(projected: Projected, values: tuple[Tensor, Tensor, Tensor], channels: int) -> Tensor:
    """``view.composite_sparse`` of begin (N + 1,) int64, channel (M,) int64 and value (M,) float32, the rows of a sparse (N, X)
    matrix: Gaussian i has the values ``begin[i]`` to ``begin[i + 1]``. The caller checks them."""
    begin, channel, value = values
    render = torch.zeros(channels, projected.height, projected.width)
    arrays = [*projected.arrays(), *map(plain, (begin.long(), channel.long(), value)), render]
    function("sparse_render", 4 * "i" + 10 * "p")(*projected.sizes(), *map(address, arrays))
    return render


def list_weights(projected: Projected, pixels: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """``view.pixel_lists`` of pixels inside the image, without rendering one. The caller checks them."""
    arrays, wanted = projected.arrays(), pixels.to(torch.int32).contiguous()
    begin = torch.zeros(len(wanted) + 1, dtype=torch.int64)
    kernel = function("pixel_weights", 4 * "i" + 6 * "p" + "ipl" + 3 * "p")
    room = _USUAL * len(wanted)
    while True:
        ids, weights = torch.empty(room, dtype=torch.int64), torch.empty(room)
        results = map(address, (begin, ids, weights))
        kernel(*projected.sizes(), *map(address, arrays), len(wanted), address(wanted), room, *results)
        if (found := int(begin[-1])) <= room:
            return begin, ids[:found], weights[:found]
        room = found


def own_weights(projected: Projected, pixels: Tensor) -> Tensor:
    """``view.own_weights``, in a tenth of the time of ``list_weights``."""
    # Numbers beyond int32 must not wrap around into the image.
    wanted = pixels.clamp(-1, max(projected.width, projected.height)).to(torch.int32).contiguous()
    weights = torch.zeros(len(projected.means2d))
    arrays = [*projected.arrays(), wanted, weights]
    function("own_weights", 4 * "i" + 8 * "p")(*projected.sizes(), *map(address, arrays))
    return weights

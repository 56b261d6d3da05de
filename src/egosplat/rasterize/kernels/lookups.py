"""What projected Gaussians show without a rendered image: sums over pixels, sparse values, single pixels. float32 on the CPU."""

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
    """Sum an (X, H, W) image over the compositing weights of N Gaussians, without rendering one.

    Returns:
        (N, X): to the bit the gradient of ``composite`` by its channels, where ``image`` is that of its render.
    """
    channels, height, width = image.shape
    sums = torch.zeros(len(projected.means2d), channels)
    arrays = [*projected.arrays(), plain(image), sums]
    sizes = (len(sums), channels, width, height, torch.get_num_threads())
    function("raster_sum", 5 * "i" + 8 * "p")(*sizes, *map(address, arrays))
    return sums


def composite_sparse(projected: Projected, values: tuple[Tensor, Tensor, Tensor], channels: int) -> Tensor:
    """Composite values of which a Gaussian has few that are not 0, on background 0. Not differentiable.

    ``values`` are begin (N + 1,) int64, channel (M,) int64 and value (M,) float32, the rows of a sparse (N, X) matrix:
    Gaussian i has the values ``begin[i]`` to ``begin[i + 1]``. The caller checks them.

    Returns:
        (X, height, width), what ``kernels.raster.composite`` renders of the dense values.
    """
    begin, channel, value = values
    render = torch.zeros(channels, projected.height, projected.width)
    arrays = [*projected.arrays(), *map(plain, (begin.long(), channel.long(), value)), render]
    function("sparse_render", 4 * "i" + 10 * "p")(*projected.sizes(), *map(address, arrays))
    return render


def list_weights(projected: Projected, pixels: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """List what (P, 2) pixels, column and row inside the image, show, without rendering an image. The caller checks them.

    Returns:
        begin (P + 1,) int64: where each pixel's list begins, and the end; Gaussians (M,) int64, nearest first; and
        their weights (M,) float32, alpha times transmittance, as ``kernels.raster.composite`` uses them.
    """
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
    """Find the weight of each Gaussian at one pixel of its own, in a tenth of the time of ``list_weights``.

    ``pixels`` are (N, 2) integers, column and row; outside the image, such as -1, for none.

    Returns:
        (N,) float32, alpha times transmittance; 0 where the pixel ends before the Gaussian, or there is none.
    """
    # Numbers beyond int32 must not wrap around into the image.
    wanted = pixels.clamp(-1, max(projected.width, projected.height)).to(torch.int32).contiguous()
    weights = torch.zeros(len(projected.means2d))
    arrays = [*projected.arrays(), wanted, weights]
    function("own_weights", 4 * "i" + 8 * "p")(*projected.sizes(), *map(address, arrays))
    return weights

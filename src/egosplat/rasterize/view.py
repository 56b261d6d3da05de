"""One view of Gaussians: composite values, sum images over Gaussians, and list what single pixels show."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from scipy import sparse
from torch import Tensor
from torch.nn.functional import embedding_bag

from egosplat.rasterize import api, cpu
from egosplat.rasterize.contract import Arguments, Render, check
from egosplat.rasterize.kernels import lookups

# Below this coverage a pixel has code 0.
_LEAST_COVERAGE = 1e-6


@dataclass(frozen=True, eq=False)
class View(Arguments):
    """N Gaussians in front of one camera, for the functions of this module, which raise as ``api.rasterization`` does.

    ``colors`` are any: the values that a function is given, or makes, take their place. ``backend`` is as in ``api.rasterization``.
    """

    backend: str = "auto"

    @property
    def _backend(self) -> str:
        return api.chosen_backend(self.backend, self.means)

    def _projected(self) -> lookups.Projected:
        """The Gaussians in the image, for the compiled kernels."""
        check(self)
        return cpu.projected(self)

    def _inside(self, pixels: Tensor) -> Tensor:
        """The same (P, 2) pixels, column and row (ValueError: one lies outside the image)."""
        if ((pixels < 0) | (pixels >= pixels.new_tensor([self.width, self.height]))).any():
            raise ValueError(f"a pixel lies outside the image of {self.width} x {self.height}")
        return pixels

    def _on_cpu(self) -> "View":
        """The same with tensors on the CPU, and the backend that the tensors had chosen; ``cpu`` for ``cuda``."""
        tensors = {name: value.cpu() for name, value in vars(self).items() if isinstance(value, Tensor)}
        backend = "reference" if self._backend == "reference" else "cpu"
        return replace(self, **tensors, backend=backend)


def render(view: View) -> Render:
    """Render a view with its own colors and features, in its mode: what ``api.rasterization`` returns."""
    check(view)
    return api.renderer(view.backend, view.means)(view)


def composite(view: View, values: Tensor) -> tuple[Tensor, Tensor]:
    """Composite (N, X) values of Gaussians, for any X; differentiable by the values.

    Returns:
        (H, W, X) image on background 0, and (H, W) accumulated opacity.
    """
    images, alphas, _ = render(replace(view, colors=values))
    return images[0], alphas[0, ..., 0]


def render_codes(view: View, code: Tensor, share: Tensor) -> tuple[Tensor, Tensor]:
    """Composite, weighted by share, (N, L, C) codes and (N, L) shares of language.zarr. (L, H, W, C) float32 weighted means, 0 where the coverage is 0; and (L, H,
    W) float32 coverage in [0, 1], accumulated compositing weight times share."""
    count, levels, channels = code.shape
    # A Gaussian counts by compositing weight times share: without labeled pixels it has no influence.
    values = torch.cat([(code * share[..., None]).reshape(count, -1), share], dim=1)
    image, _ = composite(view, values)
    sums, coverage = image.split([levels * channels, levels], dim=-1)
    sums = sums.unflatten(-1, (levels, channels)).movedim(-2, 0)
    coverage = coverage.movedim(-1, 0)
    # Decoders have biases, so the sum must be divided by its weight before it is decoded (docs/method.md#code-weight).
    covered = (coverage > _LEAST_COVERAGE)[..., None]
    codes = torch.where(covered, sums / coverage.clamp(min=_LEAST_COVERAGE)[..., None], 0.0)
    return codes, coverage


def sum_over_pixels(view: View, image: Tensor) -> Tensor:
    """Sum an (H, W, X) image over each Gaussian's compositing weights, (N, X): the transposed map of
    ``composite``. The backend cpu renders no image for it; the others take the gradient of one. Not
    differentiable. ValueError: the image has another size, dtype or device than the view."""
    kind, size = (view.means.dtype, view.means.device), (view.height, view.width)
    if image.ndim != 3 or image.shape[:2] != size or (image.dtype, image.device) != kind:
        raise ValueError(
            f"image is {tuple(image.shape)} {image.dtype} on {image.device}; {size} and channels like means is needed"
        )
    if view._backend == "cpu":
        return lookups.sum_pixels(view._projected(), image.permute(2, 0, 1))
    # Rendering is linear in the values, so its gradient is the transposed map, at any values.
    values = image.new_zeros(len(view.means), image.shape[2]).requires_grad_()
    with torch.enable_grad():
        found, _ = composite(view, values)
    return torch.autograd.grad(found, values, image)[0]


@torch.no_grad()
def composite_sparse(view: View, values: sparse.csr_array) -> Tensor:
    """Composite (N, X) values of which few are not 0, on background 0: (X, H, W). Not differentiable. The
    backend cpu takes time by their number; the others render the dense values. ValueError: the values are not
    the rows of a matrix of this dtype, with a row for each Gaussian."""
    count, channels = len(view.means), values.shape[1]
    wanted = f"the values are not the rows of a {view.means.dtype} matrix of {count} x {channels}"
    value = torch.from_numpy(values.data)
    if len(values.indptr) != count + 1 or value.dtype != view.means.dtype:
        raise ValueError(wanted)
    try:
        # The kernel writes where the indices say.
        values.check_format()
    except ValueError as error:
        raise ValueError(f"{wanted}: {error}") from error
    if view._backend == "cpu":
        begin, channel = (torch.from_numpy(each).long() for each in (values.indptr, values.indices))
        return lookups.composite_sparse(view._projected(), (begin, channel, value), channels)
    device = view.means.device
    row, channel = (torch.from_numpy(each).to(device).long() for each in values.tocoo().coords)
    # The few values are copied to the device, not the zeros between them.
    dense = view.means.new_zeros(count, channels).index_put_(
        (row, channel), value.to(device), accumulate=True
    )
    image, _ = composite(view, dense)
    return image.permute(2, 0, 1)


def pixel_renderer(view: View, pixels: Tensor) -> Callable[[Tensor], Tensor]:
    """Prepare to composite values at (P, 2) single pixels, column and row: ``composite`` without the rest of the image.

    The backend cpu lists what each pixel shows once, so that a render takes time by its pixels and no longer by the image;
    the others render the whole image. ValueError: a pixel lies outside the image.

    Returns a function of (N, X) values that gives (P, X) on background 0, differentiable by the values.
    """
    if view._backend == "cpu":
        begin, gaussians, weights = pixel_lists(view, pixels)
        options = {"mode": "sum", "include_last_offset": True, "per_sample_weights": weights}
        return lambda values: embedding_bag(gaussians, values, begin, **options)
    columns, rows = view._inside(pixels).to(view.means.device).unbind(1)
    return lambda values: composite(view, values)[0][rows, columns]


def pixel_lists(view: View, pixels: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """List what (P, 2) single pixels, column and row, show.

    The compiled kernels make the list on the CPU also for the backend cuda, because gsplat has none. The reference renders
    every Gaussian by itself, so it suits small scenes. ValueError: a pixel lies outside the image.

    Returns:
        On the CPU: begin (P + 1,) int64, where each pixel's list begins, and the end; Gaussians (M,) int64, nearest
        first; and their weights (M,), alpha times transmittance.
    """
    view, pixels = view._on_cpu(), view._inside(pixels)
    if view.backend == "reference":
        return _reference_lists(view, pixels)
    return lookups.list_weights(view._projected(), pixels)


def own_weights(view: View, pixels: Tensor) -> Tensor:
    """Find the weight of each Gaussian at one pixel of its own, on the CPU as ``pixel_lists`` does.

    ``pixels`` are (N, 2) integers, column and row; outside the image, such as -1, for none.

    Returns:
        (N,) alpha times transmittance; 0 where the pixel ends before the Gaussian, or there is none.
    """
    if pixels.shape != (len(view.means), 2):
        raise ValueError(f"pixels are {tuple(pixels.shape)}; ({len(view.means)}, 2) is needed")
    view = view._on_cpu()
    if view.backend != "reference":
        return lookups.own_weights(view._projected(), pixels)
    inside = ((pixels >= 0) & (pixels < torch.tensor([view.width, view.height]))).all(dim=1).nonzero()[:, 0]
    begin, ids, weights = _reference_lists(view, pixels[inside])
    owner = inside[torch.repeat_interleave(begin.diff())]
    own = ids == owner
    return weights.new_zeros(len(pixels)).index_put((owner[own],), weights[own])


def _reference_lists(view: View, pixels: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    # Each Gaussian is a channel of its own.
    colors = torch.eye(len(view.means), dtype=view.means.dtype)
    images, _, meta = render(replace(view, colors=colors))
    order = meta["depths"][0].argsort(stable=True)
    shown = images[0, pixels[:, 1], pixels[:, 0]][:, order]
    pixel, place = shown.nonzero(as_tuple=True)
    counts = torch.bincount(pixel, minlength=len(pixels))
    return torch.cat([counts.new_zeros(1), counts.cumsum(0)]), order[place], shown[pixel, place]

"""The rasterizer backend of the compiled kernels: float32 on the CPU."""

from collections.abc import Sequence

import torch
from torch import Tensor

from egosplat.errors import UserError
from egosplat.rasterize.contract import MIN_DEPTH_ALPHA, Arguments, Render
from egosplat.rasterize.kernels import library
from egosplat.rasterize.kernels.lookups import Projected
from egosplat.rasterize.kernels.raster import composite, project


def rasterization(arguments: Arguments) -> Render:
    """``api.rasterization`` with the compiled kernels; the images are views of planar ones (UserError: the
    kernels are not compiled, or the tensors are not float32 on the CPU)."""
    a = arguments
    _check_usable(a)
    sh, extra = _sources(a)
    projected = [project(a, camera, sh, extra) for camera in range(len(a.viewmats))]
    means2d, conics, depths, seen, _, _, radii = (_batch(each) for each in zip(*projected, strict=True))
    images = [
        # Centers come from the batch, because density control reads the batch's gradient.
        composite(means2d[index], *each[1:], _background(a, index), a.width, a.height)
        for index, each in enumerate(projected)
    ]
    renders = _batch([_finished(a, render, alpha).permute(1, 2, 0) for render, alpha in images])
    alphas = _batch([alpha[..., None] for _, alpha in images])
    meta = {"means2d": means2d, "radii": radii, "depths": depths, "conics": conics, "opacities": seen}
    return renders, alphas, meta | {"width": a.width, "height": a.height, "n_cameras": len(images)}


@torch.no_grad()
def projected(a: Arguments) -> Projected:
    """The Gaussians in the image of the one camera; colors are not used. Errors are as above."""
    _check_usable(a)
    means2d, conics, depths, seen, _, variances_y, radii = project(a, 0, None, None)
    return Projected(means2d, conics, depths, seen, variances_y, radii, a.width, a.height)


def _check_usable(a: Arguments) -> None:
    if why_not := library.why_not():
        raise UserError(why_not)
    if a.means.dtype != torch.float32 or a.means.device.type != "cpu":
        raise UserError(
            f"backend cpu renders float32 on the CPU, not {a.means.dtype} on {a.means.device}: use reference"
        )


def _sources(a: Arguments) -> tuple[Tensor | None, Tensor | None]:
    """Spherical harmonics to evaluate, and channels to composite unchanged."""
    if not a.shows_colors:
        return None, None
    if a.sh_degree is not None:
        return a.colors, a.features
    return None, a.colors if a.features is None else torch.cat([a.colors, a.features], dim=-1)


def _background(a: Arguments, index: int) -> Tensor | None:
    if a.backgrounds is None or not a.shows_colors:
        return None
    background = a.backgrounds[index]
    # A depth has no background.
    return torch.nn.functional.pad(background, (0, 1)) if a.shows_depth else background


def _finished(a: Arguments, render: Tensor, alpha: Tensor) -> Tensor:
    """(X, H, W) with accumulated depth converted to expected depth in the modes that show it."""
    if not a.shows_expected_depth:
        return render
    return torch.cat([render[:-1], render[-1:] / alpha.clamp(min=MIN_DEPTH_ALPHA)])


def _batch(tensors: Sequence[Tensor]) -> Tensor:
    """Stack along a new first axis; a single tensor is not copied."""
    return tensors[0][None] if len(tensors) == 1 else torch.stack(list(tensors))

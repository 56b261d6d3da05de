"""How well Gaussians render photographs: PSNR and SSIM by torchmetrics."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torchmetrics.functional.image import peak_signal_noise_ratio, structural_similarity_index_measure

from egosplat.errors import UserError
from egosplat.splats.gaussians import Gaussians
from egosplat.splats.options import RenderOptions
from egosplat.splats.render import render
from egosplat.splats.views import Views

_LEAST_SIDE = 6
"""Of a picture [px]: torchmetrics mirrors 5 px at its border for SSIM."""


@dataclass(frozen=True)
class Scores:
    """Of V pictures: PSNR [dB] and SSIM, (V,) float64 each; the PSNR is NaN of a picture without a valid pixel."""

    psnr: NDArray[np.float64]
    ssim: NDArray[np.float64]

    @property
    def mean_psnr(self) -> float:
        """Of the pictures with a valid pixel; NaN where there is none."""
        known = self.psnr[~np.isnan(self.psnr)]
        return float(known.mean()) if len(known) else float("nan")

    @property
    def mean_ssim(self) -> float:
        """NaN where there is no picture."""
        return float(self.ssim.mean()) if len(self.ssim) else float("nan")


@torch.no_grad()
def evaluate(
    gaussians: Gaussians,
    views: Views,
    options: RenderOptions,
    sh_degree: int,
    show: Callable[[int, NDArray[np.uint8]], object] = lambda index, picture: None,
) -> Scores:
    """Render and score every view.

    Args:
        gaussians: to be rendered, on the device of the views.
        views: what they are compared with; may be empty.
        options: how to render; a random background is black here.
        sh_degree: degree in use.
        show: is given the index and the rendered (H, W, 3) uint8 picture of each view.

    Raises:
        UserError: the pictures are too small for SSIM.
    """
    camera = views.camera
    if len(views) and min(camera.width, camera.height) < _LEAST_SIDE:
        raise UserError(
            f"splats: pictures of {camera.width} x {camera.height} pixels cannot be scored; raise frames.resolution"
        )
    scores = np.empty((len(views), 2))
    for index in range(len(views)):
        image = rendered(gaussians, views, index, options, sh_degree)
        scores[index] = picture_scores(image, views.picture(index), views.weight(index))
        show(index, (image * 255.0).round().to("cpu", torch.uint8).numpy())
    return Scores(scores[:, 0], scores[:, 1])


def rendered(
    gaussians: Gaussians, views: Views, index: int, options: RenderOptions, sh_degree: int
) -> Tensor:
    """(H, W, 3) float32 picture of a view, clamped to [0, 1]."""
    image, _, _ = render(
        gaussians,
        views.camera,
        views.camera_to_world[index],
        sh_degree=sh_degree,
        background=torch.ones(3) if options.background == "white" else None,
        near_plane=options.near_plane,
        antialiased=options.antialiased,
        backend=options.backend,
    )
    return image[..., :3].clamp(0.0, 1.0)


def picture_scores(image: Tensor, truth: Tensor, weight: Tensor | None) -> tuple[float, float]:
    """PSNR [dB] over the valid pixels, and SSIM of the picture whose invalid pixels are the truth's.

    SSIM has no value for a part of a picture; invalid pixels raise it a little, for all methods alike.

    Args:
        image, truth: (H, W, 3) float32 in [0, 1].
        weight: (H, W) float32, of which pixels below a half are invalid; None where all are valid.
    """
    valid = torch.ones_like(truth[..., 0], dtype=torch.bool) if weight is None else weight >= 0.5
    psnr = peak_signal_noise_ratio(image[valid], truth[valid], data_range=1.0)
    shown = torch.where(valid[..., None], image, truth)
    pair = (picture.permute(2, 0, 1)[None].contiguous() for picture in (shown, truth))
    ssim = structural_similarity_index_measure(*pair, data_range=1.0)
    return float(psnr), float(ssim)

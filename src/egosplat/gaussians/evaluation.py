"""Score renders against photographs: PSNR and SSIM of 8-bit images."""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from egosplat.arrays import Array, Bytes
from egosplat.gaussians.exposure import expose
from egosplat.gaussians.render import TrainedScene
from egosplat.gaussians.training_views import Views
from egosplat.geometry import Camera
from egosplat.image_quality import mean_ssim, psnr, ssim_map

# PSNR [dB] and SSIM of V images, (V,) float64 each; NaN for an image without a valid pixel, or SSIM window.
Scores = tuple[Array, Array]


def mean_known(values: Array) -> float:
    """Mean of ``Scores`` over the images with a value, NaN if there is none."""
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else float("nan")


def describe(psnr: Array, ssim: Array) -> str:
    """The means of scores in words."""
    return f"PSNR {mean_known(psnr):.2f} dB, SSIM {mean_known(ssim):.3f}"


@torch.no_grad()
def evaluate(
    scene: TrainedScene,
    views: Views,
    show: Callable[[int, Bytes], object] = lambda index, picture: None,
) -> Scores:
    """Render and score every view; there may be none. ``show`` is called with the index and the rendered (H,
    W, 3) uint8 image of each."""
    scores = np.empty((len(views), 2))
    for index in range(len(views)):
        log_gain = None if views.log_gain is None else views.log_gain[index]
        picture = develop(scene, views.camera, views.camera_to_world[index], log_gain, views.compression)
        truth, weight = views.pictures[index].to(views.device), views.weight(index)
        # A predicted M is a probability; scores take a pixel wholly or not at all.
        valid = torch.ones_like(truth[..., 0], dtype=torch.bool) if weight is None else weight >= 0.5
        scores[index] = psnr(picture, truth, valid), mean_ssim(ssim_map(picture, truth, valid), valid)
        show(index, picture.cpu().numpy())
    return scores[:, 0], scores[:, 1]


@torch.no_grad()
def develop(
    scene: TrainedScene, camera: Camera, pose: Array, log_gain: Tensor | None, compression: Tensor | None
) -> Tensor:
    """Render the (H, W, 3) uint8 image of a pose that is stored and scored, with (3,) gains as of ``expose`` if there are any."""
    colors = scene.rendered(camera, pose)
    if log_gain is not None:
        colors = expose(colors, log_gain, compression)
    return (colors.clamp(0.0, 1.0) * 255.0).round().to(torch.uint8)

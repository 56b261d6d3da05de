"""Fit the pose and the exposure of photographs outside the training to Gaussians that stay as they are."""

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from egosplat.gaussians.corrections import (
    LAST_RATE,
    LOG_GAIN,
    POSE,
    Corrections,
    adam,
    corrected,
    learning_rates,
)
from egosplat.gaussians.exposure import SATURATED, simulate_photograph
from egosplat.gaussians.loss import l1_ssim
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, render
from egosplat.gaussians.training_views import Views

# Steps of each photograph. Each renders it once, forwards and backwards.
STEPS = 40

# All steps add up to this part of the reach of training: with longer steps, 40 do not settle.
_REACH = 0.4

_SSIM_LAMBDA = 0.2

# Largest logarithm of a gain that the first guess may have.
_MOST_LOG_GAIN = 5.0


def fit(
    gaussians: Gaussians,
    views: Views,
    guess: Tensor,
    corrections: Corrections,
    settings: RenderSettings,
    sh_degree: int,
) -> Tensor:
    """Corrections of V views that render most like their photographs; the Gaussians do not change.

    Args:
        views: photographs; pixels with weight 0 do not count.
        guess: (V, 9) corrections to start from, unless no correction at all is better.
        corrections: of the training: which are optimized, the depth of the scene, and the compression of the camera.

    Returns:
        (V, 9) float64, for each view the best of all steps.
    """
    rates = _REACH * learning_rates(corrections.options, corrections.depth, STEPS)
    views = replace(views, compression=corrections.compression)
    fitted = torch.zeros_like(guess)
    for index in range(len(views)):
        photograph = _Photograph(gaussians.detach(), views, index, settings, sh_degree)
        starts = [torch.zeros_like(guess[index]), guess[index]]
        if corrections.options.compensate_exposure == "on":
            starts += [photograph.with_best_gain(start) for start in starts]
        fitted[index] = _lowest(photograph, starts, rates)
    return fitted


@dataclass(frozen=True)
class _Photograph:
    """One view, and the Gaussians that are compared with it."""

    gaussians: Gaussians
    views: Views
    index: int
    settings: RenderSettings
    sh_degree: int

    def render(self, values: Tensor) -> Tensor:
        """Render (H, W, 3) with the pose of a correction (9,), without its gain."""
        pose = corrected(torch.from_numpy(self.views.camera_to_world[self.index]), values[POSE])
        background, degree = self.settings.still_background, self.sh_degree
        camera, settings = self.views.camera, self.settings
        image, _, _ = render(self.gaussians, camera, pose, settings, sh_degree=degree, background=background)
        return image[..., :3]

    def loss(self, values: Tensor) -> Tensor:
        """Loss of a correction, that of training."""
        picture, weight = self.views.picture(self.index), self.views.weight(self.index)
        image = simulate_photograph(self.render(values), values[LOG_GAIN], picture, self.views.compression)
        return l1_ssim(image, picture, weight, _SSIM_LAMBDA)

    @torch.no_grad()
    def with_best_gain(self, values: Tensor) -> Tensor:
        """The correction with the gains of the least squared error; where nothing measures a gain, it stays."""
        image, picture = self.render(values), self.views.picture(self.index)
        weight = self.views.weight(self.index)
        weight = torch.ones_like(image[..., :1]) if weight is None else weight[..., None]
        weight = weight * (picture < SATURATED)
        above, below = ((weight * image * other).double().sum(dim=(0, 1)).cpu() for other in (picture, image))
        log_gain = (above / below).log().clamp(-_MOST_LOG_GAIN, _MOST_LOG_GAIN)
        return torch.cat([values[POSE], torch.where(log_gain.isnan(), values[LOG_GAIN], log_gain)])


def _lowest(photograph: _Photograph, starts: list[Tensor], rates: Tensor) -> Tensor:
    """The correction (9,) of the lowest loss in a descent from the best of ``starts``."""
    with torch.no_grad():
        start = min(starts, key=lambda values: float(photograph.loss(values)))
    values, moments = start.clone(), torch.zeros(2, len(start), dtype=start.dtype)
    best, least = start, math.inf
    for step in range(STEPS):
        leaf = values.clone().requires_grad_()
        loss = photograph.loss(leaf)
        loss.backward()
        if leaf.grad is None or not bool(leaf.grad.isfinite().all()):
            break
        if float(loss.detach()) < least:
            best, least = values.clone(), float(loss.detach())
        with torch.no_grad():
            adam(values, moments, leaf.grad, rates * LAST_RATE ** (step / STEPS), step + 1)
    return best

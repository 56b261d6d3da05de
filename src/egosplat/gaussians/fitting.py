"""Fit the pose and the exposure of photographs outside the training to Gaussians that stay as they are."""

import math
from collections.abc import Callable
from dataclasses import replace

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
from egosplat.gaussians.exposure import SATURATED, expose
from egosplat.gaussians.loss import l1_ssim
from egosplat.gaussians.render import TrainedScene
from egosplat.gaussians.training_views import Views

# Steps of each photograph. Each renders it once, forwards and backwards.
STEPS = 40

# All steps add up to this part of the reach of training: with longer steps, 40 do not settle.
_REACH = 0.4

_SSIM_LAMBDA = 0.2

# Largest logarithm of a gain that the first guess may have.
_MOST_LOG_GAIN = 5.0


def fit(scene: TrainedScene, views: Views, guess: Tensor, corrections: Corrections) -> Tensor:
    """Corrections of V views that render most like their photographs; the Gaussians do not change. ``views``:
    photographs; pixels with weight 0 do not count. ``guess``: (V, 9) corrections to start from, unless no
    correction at all is better. ``corrections``: of the training: which are optimized, the depth of the
    scene, and the compression of the camera. Returns (V, 9) float64, for each view the best of all steps."""
    rates = _REACH * learning_rates(corrections.options, corrections.depth, STEPS)
    scene, fitted = replace(scene, gaussians=scene.gaussians.detach()), torch.zeros_like(guess)
    for index in range(len(views)):
        picture, weight = views.picture(index), views.weight(index)
        camera_to_world = torch.from_numpy(views.camera_to_world[index])

        def colors(values: Tensor, given: Tensor = camera_to_world) -> Tensor:
            return scene.rendered(views.camera, corrected(given, values[POSE]))

        def loss(values: Tensor, picture: Tensor = picture, weight: Tensor | None = weight) -> Tensor:
            image = expose(colors(values), values[LOG_GAIN], corrections.compression, picture)
            return l1_ssim(image, picture, weight, _SSIM_LAMBDA)

        starts = [torch.zeros_like(guess[index]), guess[index]]
        if corrections.options.compensate_exposure == "on":
            with torch.no_grad():
                starts += [with_best_gain(start, colors(start), picture, weight) for start in starts]
        fitted[index] = _lowest(loss, starts, rates)
    return fitted


def with_best_gain(values: Tensor, image: Tensor, picture: Tensor, weight: Tensor | None) -> Tensor:
    """A correction (9,) with the gains of the least squared error; where nothing measures a gain, it stays.
    ``image``, ``picture``: (H, W, 3) render without a gain and photograph; weight: (H, W), None for ones."""
    weight = torch.ones_like(image[..., 0]) if weight is None else weight
    weight = weight[..., None] * (picture < SATURATED)
    above, below = ((weight * image * other).double().sum(dim=(0, 1)).cpu() for other in (picture, image))
    log_gain = (above / below).log().clamp(-_MOST_LOG_GAIN, _MOST_LOG_GAIN)
    return torch.cat([values[POSE], torch.where(log_gain.isnan(), values[LOG_GAIN], log_gain)])


def _lowest(loss_of: Callable[[Tensor], Tensor], starts: list[Tensor], rates: Tensor) -> Tensor:
    """The correction (9,) of the lowest loss in a descent from the best of ``starts``."""
    with torch.no_grad():
        start = min(starts, key=lambda values: float(loss_of(values)))
    values, moments = start.clone(), torch.zeros(2, len(start), dtype=start.dtype)
    best, least = start, math.inf
    for step in range(STEPS):
        leaf = values.clone().requires_grad_()
        loss = loss_of(leaf)
        loss.backward()
        if leaf.grad is None or not bool(leaf.grad.isfinite().all()):
            break
        if float(loss.detach()) < least:
            best, least = values.clone(), float(loss.detach())
        with torch.no_grad():
            adam(values, moments, leaf.grad, rates * LAST_RATE ** (step / STEPS), step + 1)
    return best

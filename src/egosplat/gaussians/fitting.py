"""Fit the pose and the exposure of photographs outside the training to Gaussians that stay as they are."""

import torch
from torch import Tensor

from egosplat.gaussians.corrections import LOG_GAIN, POSE, CorrectionOptions, adam, learning_rates
from egosplat.gaussians.exposure import exposed
from egosplat.gaussians.loss import l1_ssim
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, render
from egosplat.gaussians.rigid import corrected
from egosplat.gaussians.training_views import Views

# Steps of each photograph. Each renders it once, forwards and backwards.
STEPS = 40

_LAST_RATE = 0.01
_SSIM_LAMBDA = 0.2


def fit(
    gaussians: Gaussians,
    views: Views,
    guess: Tensor,
    options: CorrectionOptions,
    depth: float,
    settings: RenderSettings,
    sh_degree: int,
) -> Tensor:
    """Corrections of V views that render most like their photographs; the Gaussians do not change.

    Args:
        guess: (V, 9) corrections to start from, unless no correction at all is better.
        depth: as ``Corrections.depth``.

    Returns:
        (V, 9) float64, for each view the best of all steps.
    """
    gaussians = gaussians.detach()
    found = torch.zeros_like(guess)

    def loss_of(index: int, values: Tensor) -> Tensor:
        pose = corrected(torch.from_numpy(views.camera_to_world[index]), values[POSE])
        background = settings.still_background
        image, _, _ = render(
            gaussians, views.camera, pose, settings, sh_degree=sh_degree, background=background
        )
        colours = exposed(image[..., :3], values[LOG_GAIN])
        return l1_ssim(colours, views.picture(index), views.weight(index), _SSIM_LAMBDA)

    for index in range(len(views)):
        rates = learning_rates(options, depth, STEPS)
        found[index] = _fit_one(index, guess[index], rates, loss_of)
    return found


def _fit_one(index, guess, rates, loss_of):
    best, best_loss = guess, float("inf")
    with torch.no_grad():
        starts = {float(loss_of(index, start)): start for start in (torch.zeros_like(guess), guess)}
    values, moments = starts[min(starts)].clone(), guess.new_zeros(2, len(guess))
    for step in range(STEPS):
        leaf = values.clone().requires_grad_()
        loss = loss_of(index, leaf)
        if float(loss.detach()) < best_loss:
            best, best_loss = values.clone(), float(loss.detach())
        loss.backward()
        with torch.no_grad():
            adam(values, moments, leaf.grad, rates * _LAST_RATE ** (step / STEPS), step + 1)
    return best

"""Gaussians of a thing at rest: what the photographs show on top of the scene, which stays as it is."""

from collections.abc import Sequence

import numpy as np
import torch

from egosplat.arrays import Array, Bools
from egosplat.gaussians.initialization import from_points
from egosplat.gaussians.loss import l1_ssim
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.optimizer import Adam, LearningRates
from egosplat.gaussians.render import view_of
from egosplat.geometry import invert, transform
from egosplat.histories.places import End, PlaceView, Recording
from egosplat.rasterize.view import sum_over_pixels

# Points that a thing starts from, in this part of the place's radius.
_POINTS, _WITHIN = 300, 0.8
# The learning rate of the means is this part of the radius, and is multiplied by this after each step.
_RATE, _DECAY = 0.0032, 0.995
# Few and short steps: all other rates are larger than those of a scene.
_RATES = {"quats": 0.002, "log_scales": 0.01, "logit_opacities": 0.05, "sh_dc": 0.01, "sh_rest": 0.0005}

_SSIM_LAMBDA = 0.2
# Weight of the mean opacity in the loss: a Gaussian that explains nothing disappears.
_OPACITY_WEIGHT = 0.002
# Gaussians below this opacity are left out in the end.
_LEAST_OPACITY = 0.05
# A Gaussian belongs to a thing if more than this share of what it shows is explained by it.
_HALF = 0.5
# A pixel counts as changed from this sum of differences of red, green and blue.
_CHANGED = 0.05


def start_points(end: End, views: Sequence[PlaceView], recording: Recording) -> Gaussians:
    """Gaussians in the sphere of an end of a carry, with the mean color of the pixels that show them."""
    draw = np.random.default_rng(recording.seed)
    direction = draw.normal(size=(_POINTS, 3))
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    points = end.center + _WITHIN * end.radius * direction * draw.random((_POINTS, 1)) ** (1 / 3)
    total, count = np.zeros((_POINTS, 3)), np.zeros((_POINTS, 1))
    for view in views:
        pixels = view.camera.project(transform(invert(view.camera_to_world), points))
        inside = view.camera.contains(pixels)
        column, row = pixels[inside].astype(int).T
        total[inside] += view.picture[row, column]
        count[inside] += 1
    colors = np.where(count > 0, total / np.maximum(count, 1), 127.0).astype(np.uint8)
    how = {"max_points": _POINTS, "seed": recording.seed}
    degree, near_plane = recording.gaussians.sh_degree, recording.settings.near_plane
    made = from_points(points, colors, sh_degree=degree, near_plane=near_plane, **how)
    return made.to(recording.gaussians.means.device)


def fit(start: Gaussians, views: Sequence[PlaceView], seed: int, radius: float, iterations: int) -> Gaussians:
    """Train Gaussians that explain views on top of the scene; one view an iteration."""
    copies = {name: value.detach().clone() for name, value in start.parameters().items()}
    gaussians = Gaussians(**copies).requires_grad_()
    optimizer = Adam(gaussians, LearningRates(means=_RATE * radius, **_RATES))
    draw, order = np.random.default_rng(seed), []
    for _ in range(iterations):
        order = order or draw.permutation(len(views)).tolist()
        view = views[order.pop()]
        optimizer.zero_grad()
        image, weight = view.render(gaussians), torch.from_numpy(view.shown)
        loss = l1_ssim(image, view.colors.to(image), weight.to(image), _SSIM_LAMBDA)
        (loss + _OPACITY_WEIGHT * gaussians.opacities.mean()).backward()
        optimizer.step(None)
        optimizer.means_lr *= _DECAY
    return gaussians.detach()


@torch.no_grad()
def essential(gaussians: Gaussians, views: Sequence[PlaceView]) -> Gaussians:
    """Those Gaussians that are mostly where the error falls; the others repeat the scene around the thing."""
    total = torch.zeros(gaussians.count, 2, dtype=torch.float64)
    for view in views:
        both = np.stack([improved(view, gaussians), view.shown], axis=-1)
        pixels = torch.from_numpy(both).float()
        every = view.with_scene(gaussians)
        seen = view_of(every, view.camera, view.camera_to_world, view.recording.settings)
        total += sum_over_pixels(seen, pixels.to(every.means.device))[-gaussians.count :].double().cpu()
    kept = (total[:, 0] > _HALF * total[:, 1]).to(gaussians.means.device)
    return gaussians.select(kept & gaussians.finite() & (gaussians.opacities >= _LEAST_OPACITY))


@torch.no_grad()
def improved(view: PlaceView, gaussians: Gaussians) -> Bools:
    """(h, w) bool: shown pixels whose error is clearly lower with Gaussians than without."""
    return (view.error - view.error_with(gaussians) > _CHANGED).cpu().numpy() & view.shown


@torch.no_grad()
def explained(gaussians: Gaussians, views: Sequence[PlaceView]) -> Array:
    """(V, 3) float64 for the pixels of each view that Gaussians change: by how much their absolute error falls, the larger of
    the errors without and with them, and the number of pixels."""
    rows = []
    for view in views:
        before, after = view.error, view.error_with(gaussians)
        changed = ((before - after).abs() > _CHANGED) & torch.from_numpy(view.shown).to(before.device)
        before, after = before[changed].double(), after[changed].double()
        larger = torch.maximum(before, after)
        rows.append((float((before - after).sum()), float(larger.sum()), int(changed.sum())))
    return np.array(rows, np.float64).reshape(-1, 3)

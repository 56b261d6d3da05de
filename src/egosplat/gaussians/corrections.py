"""Corrections of each training view, optimized together with the Gaussians: its pose and its exposure.
docs/method.md#corrections has the formulas. A pose's correction is a translation of the camera's center and a
rotation vector about it, both along the axes of the world, so neither depends on where the world's origin
lies."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.gaussians.exposure import expose
from egosplat.gaussians.initialization import seen_depths
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.training_views import Views
from egosplat.pipeline.shared_options import CameraOptions
from egosplat.pipeline.validation import read_document

# Columns of a correction: translation [m], rotation vector [rad], natural logarithm of the gain of R, G and B.
POSE, LOG_GAIN, COLUMNS = slice(0, 6), slice(6, 9), 9

# How far a correction can move in one training, all steps added up: an angle [rad], the same as a translation in
# depths of the scene, so that both move the picture equally far; a log gain; the compression of highlights, which all
# views share, so that most of its steps cancel.
REACH_RAD, REACH_LOG_GAIN, _REACH_COMPRESSION = 0.1, 0.5, 4.0

# The learning rate falls to this fraction, as that of the Gaussians' centers; the mean of the sequence from 1 to there.
LAST_RATE = 0.01
_MEAN_RATE = (1.0 - LAST_RATE) / -math.log(LAST_RATE)

# Fewer visits than this do not raise the learning rate any more.
_LEAST_VISITS = 20

_BETA1, _BETA2, _EPS = 0.9, 0.99, 1e-15

Options = TypeVar("Options", bound=CameraOptions)


def resolve_camera(options: Options, survey_path: Path | None) -> Options:
    """Replace ``auto`` by the survey's decision, or ``off`` without one; the workflow gives no ``auto``. UserError as its reader."""
    keys = [key for key in CameraOptions.model_fields if getattr(options, key) == "auto"]
    decisions = read_document(survey_path, "survey")["camera"] if keys and survey_path is not None else {}
    return options.change(**{name: "on" if decisions.get(name) else "off" for name in keys})


def make_corrections(
    options: CameraOptions, start: Gaussians, views: Views, near_plane: float, iterations: int
) -> "Corrections | None":
    """The corrections of a training from ``start``, of options after ``resolve_camera``; None if nothing is corrected."""
    if "on" not in (options.refine_poses, options.compensate_exposure):
        return None
    depths = seen_depths(start.means.double().cpu().numpy(), views, near_plane)
    return Corrections(options, views, float(np.median(depths)) if len(depths) else 1.0, iterations)


class Corrections:
    """The corrections of V training views.

    Only views that were trained on have one. Their mean is zero at any time: the cameras as a whole neither move nor
    turn, and the geometric mean of the gains is 1, so that the Gaussians keep the recording's mean exposure.

    Attributes:
        options: what is ``on`` is optimized; the other columns stay 0.
        values: (V, 9) float64 on the CPU, see ``POSE`` and ``LOG_GAIN``.
        compression: (1,) float64 of the camera's tone curve, 0 or more, see ``expose``; one for all views.
        steps: (V,) int64 number of steps of each view.
        depth: median depth of the scene [m], the unit of translations.
    """

    def __init__(self, options: CameraOptions, views: Views, depth: float, iterations: int) -> None:
        """Start without any correction; ``iterations`` is the length of the training."""
        self.options, self.depth = options, depth
        self._camera_to_world, self._frame = torch.from_numpy(views.camera_to_world), views.frame
        self._iterations = iterations
        self._rates = learning_rates(options, depth, iterations / max(len(views), 1))
        self._compression_rate = torch.tensor([_REACH_COMPRESSION / (iterations * _MEAN_RATE)])
        self.values = torch.zeros(len(views), COLUMNS, dtype=torch.float64)
        self.compression = torch.zeros(1, dtype=torch.float64)
        self.steps = torch.zeros(len(views), dtype=torch.int64)
        self._moments = torch.zeros(2, len(views), COLUMNS, dtype=torch.float64)
        self._compression_moments = torch.zeros(2, 1, dtype=torch.float64)
        # The row of ``values`` of the current view, then the compression.
        self._leaf = torch.zeros(0)

    def camera_to_world(self, index: int) -> Tensor | NDArray[np.float64]:
        """Pose of a view for ``render``, (4, 4) float64; a tensor with a gradient if poses are refined."""
        self._leaf = torch.cat([self.values[index], self.compression]).requires_grad_()
        if self.options.refine_poses != "on":
            return self._camera_to_world[index].numpy()
        return corrected(self._camera_to_world[index], self._leaf[POSE])

    def exposed(self, image: Tensor, picture: Tensor) -> Tensor:
        """Expose an (H, W, 3 + F) render of the view of the last ``camera_to_world`` as its (H, W, 3) photograph is."""
        if self.options.compensate_exposure != "on":
            return image
        # Copied to a GPU together: each copy waits for it on the way back.
        tone = self._leaf[LOG_GAIN.start :].to(image)
        return expose(image, tone[:-1], tone[-1:], picture)

    @torch.no_grad()
    def step(self, index: int, iteration: int) -> None:
        """Update the view of the last ``camera_to_world`` from its gradient, one step of Adam (Kingma & Ba
        2015). A gradient that is not finite changes nothing."""
        gradient = self._leaf.grad
        if gradient is None or not bool(gradient.isfinite().all()):
            return
        self.steps[index] += 1
        decay = LAST_RATE ** (iteration / self._iterations)
        own, shared = gradient[:COLUMNS], gradient[COLUMNS:]
        adam(self.values[index], self._moments[:, index], own, self._rates * decay, int(self.steps[index]))
        rate, steps = self._compression_rate * decay, int(self.steps.sum())
        adam(self.compression, self._compression_moments, shared, rate, steps)
        self.compression.clamp_(min=0.0)
        trained = self.steps > 0
        self.values[trained] -= self.values[trained].mean(dim=0)

    @property
    def trained_frames(self) -> NDArray[np.int64]:
        """Frames with a correction of their own, (T,) int64."""
        return self._frame[(self.steps > 0).numpy()]

    @property
    def smooth(self) -> bool:
        """Whether corrections of other frames are interpolated, see ``values_at``."""
        return predicts(self.trained_frames, self.values[self.steps > 0].numpy())

    def values_at(self, frames: NDArray[np.integer]) -> Tensor:
        """Corrections of any frames, (M, 9): a training view's own, else from the training views before and
        after. Interpolated if that predicts the corrections of the training views themselves better than 0
        does: the error of a device's trajectory changes slowly, that of single photographs does not."""
        known, own = self.trained_frames, self.values[self.steps > 0].numpy()
        result = np.zeros((len(frames), COLUMNS))
        if len(known):
            result = np.stack([np.interp(frames, known, column) for column in own.T], axis=1)
        if not self.smooth:
            result[~np.isin(frames, known)] = 0.0
        return torch.from_numpy(result)

    def state_dict(self) -> dict[str, Tensor]:
        """Return the state for ``load_state_dict``."""
        names = ("values", "steps", "_moments", "compression", "_compression_moments")
        return {name: getattr(self, name) for name in names}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state from ``state_dict``."""
        for name in self.state_dict():
            setattr(self, name, state[name].cpu())


def learning_rates(options: CameraOptions, depth: float, visits: float) -> Tensor:
    """(9,) learning rates of the first step: they add up to the reach over the ``visits`` of a view; 0 if not optimized."""
    reach = [REACH_RAD * depth] * 3 + [REACH_RAD] * 3 + [REACH_LOG_GAIN] * 3
    used = [options.refine_poses == "on"] * 6 + [options.compensate_exposure == "on"] * 3
    return torch.tensor(reach) * torch.tensor(used) / (max(visits, _LEAST_VISITS) * _MEAN_RATE)


def adam(values: Tensor, moments: Tensor, gradient: Tensor, rates: Tensor, step: int) -> None:
    """One step of Adam in place, of (n,) ``values`` with (2, n) ``moments``; ``step`` counts from 1."""
    moments[0].lerp_(gradient, 1.0 - _BETA1)
    moments[1].lerp_(gradient.square(), 1.0 - _BETA2)
    first, second = moments[0] / (1.0 - _BETA1**step), moments[1] / (1.0 - _BETA2**step)
    values -= rates * first / (second.sqrt() + _EPS)


def predicts(known: NDArray[np.integer], values: NDArray[np.float64]) -> bool:
    """Whether interpolation between the neighbors of (K, C) values at (K,) increasing frames is nearer to
    them than 0 is. In total, each column divided by its mean square."""
    if len(known) < 3:
        return False
    share = ((known[1:-1] - known[:-2]) / (known[2:] - known[:-2]))[:, None]
    guess = (1.0 - share) * values[:-2] + share * values[2:]
    size = np.square(values).mean(axis=0)
    error = np.square(values[1:-1] - guess).mean(axis=0)
    used = size > 0
    return bool(used.any()) and float((error[used] / size[used]).mean()) < 1.0


def applied(views: Views, values: Tensor, compression: Tensor | None = None) -> Views:
    """Views with the poses and gains of corrections (V, 9), and with the (1,) compression of their camera."""
    poses = corrected_poses(views.camera_to_world, values)
    return replace(views, camera_to_world=poses, log_gain=values[:, LOG_GAIN], compression=compression)


def corrected_poses(camera_to_world: NDArray[np.float64], values: Tensor) -> NDArray[np.float64]:
    """Poses (V, 4, 4) float64 after corrections (V, 9); NaN stays."""
    return corrected(torch.from_numpy(camera_to_world), values[:, POSE]).numpy()


def corrected(camera_to_world: Tensor, correction: Tensor) -> Tensor:
    """Apply (..., 6) float64 translations [m] and rotation vectors [rad] to (..., 4, 4) poses; zeros keep every bit."""
    x, y, z = correction[..., 3:].unbind(-1)
    zero = torch.zeros_like(x)
    rows = [torch.stack(row, -1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    rotation = torch.linalg.matrix_exp(torch.stack(rows, -2)) @ camera_to_world[..., :3, :3]
    center = camera_to_world[..., :3, 3] + correction[..., :3]
    above = torch.cat([rotation, center[..., None]], dim=-1)
    return torch.cat([above, camera_to_world[..., 3:, :]], dim=-2)

"""Gaussians that masks are merged on: those of the scene, or temporary ones."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from egosplat.arrays import Array, Bools
from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import camera_poses
from egosplat.gaussians.corrections import applied, corrected_poses
from egosplat.gaussians.io import read_gaussians
from egosplat.gaussians.loss import L1Ssim
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings
from egosplat.gaussians.schedule import TrainingOptions
from egosplat.gaussians.trainer import begin, train_alone
from egosplat.gaussians.training_views import Views, read_views
from egosplat.instances.options import InstancesOptions
from egosplat.rasterize.api import training_device

# Comparing masks needs surfaces, not texture: fewer Gaussians than a render, of one color each.
_FEW: dict[str, Any] = {"max_points": 40_000, "max_gaussians": 60_000}


@dataclass(frozen=True, eq=False)
class Geometry:
    """Gaussians that masks are merged on, and the views that show them at the working size.

    Attributes:
        gaussians: on the device of the backend, without gradients.
        views: the training views.
        camera_to_world: (F, 4, 4) float64 poses of all frames, refined ones if poses are refined; NaN without one.
        settings: render settings.
    """

    gaussians: Gaussians
    views: Views
    camera_to_world: Array
    settings: RenderSettings


def train_geometry(
    frames: Artifact, poses: Artifact, training: Bools, keys: InstancesOptions, output: Path, key: str
) -> Geometry:
    """Train Gaussians for a short time at the working size, on all pixels of the ``training`` (F,) bool
    frames, all with a pose. A killed run resumes from its checkpoint with this ``key``, which is kept next to
    ``output``."""
    device = training_device(keys.backend)
    views = read_views(frames, poses, training, device, resolution=keys.resolution)
    options = TrainingOptions.of(keys, evaluate_every=keys.iterations, **_FEW)
    state = begin(poses, views, options, L1Ssim(options.ssim_lambda), keys)
    train_alone(state, views, Checkpoint(output, key))
    gaussians, cameras = state.gaussians.detach(), poses.read("camera_to_world")
    if (corrections := state.corrections) is not None:
        cameras = corrected_poses(cameras, corrections.values_at(np.arange(len(cameras))))
        views = applied(views, corrections.values, corrections.compression)
    return Geometry(gaussians.select(gaussians.finite()), views, cameras, options.render)


def given_geometry(
    frames: Artifact, poses: Artifact, splats: Artifact, training: Bools, keys: InstancesOptions
) -> Geometry:
    """The scene's Gaussians, with the views and poses of their training."""
    device = training_device(keys.backend)
    views = read_views(frames, poses, training, device, resolution=keys.resolution)
    cameras = camera_poses(poses, splats)
    views = replace(views, camera_to_world=cameras[views.frame])
    settings = RenderSettings(keys.near_plane, "black", keys.backend)
    return Geometry(read_gaussians(splats).to(device), views, cameras, settings)

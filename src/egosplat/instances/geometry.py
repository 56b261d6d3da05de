"""Gaussians that masks are merged on: those of the scene, or temporary ones."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import camera_poses
from egosplat.compute import single_thread
from egosplat.gaussians.corrections import applied, corrected_poses, make_corrections
from egosplat.gaussians.device import training_device
from egosplat.gaussians.initialization import scene_extent, starting_gaussians
from egosplat.gaussians.io import read_gaussians
from egosplat.gaussians.loss import L1Ssim
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings
from egosplat.gaussians.schedule import GROW_GRAD2D, TrainingOptions
from egosplat.gaussians.trainer import TrainingState, ViewSets, resume_and_train
from egosplat.gaussians.training_views import Mask, Views, read_views
from egosplat.instances.options import InstancesOptions

# Comparing masks needs surfaces, not texture: fewer Gaussians than a render, of one color each.
_MAX_POINTS = 40_000
_MAX_GAUSSIANS = 60_000


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
    camera_to_world: NDArray[np.float64]
    settings: RenderSettings


def train_geometry(
    frames: Artifact, poses: Artifact, training: Mask, keys: InstancesOptions, output: Path, key: str
) -> Geometry:
    """Train Gaussians for a short time at the working size, on all pixels of the ``training`` (F,) bool
    frames, all with a pose. A killed run resumes from its checkpoint with this ``key``, which is kept next to
    ``output``."""
    device = training_device(keys.backend)
    views, none = (
        read_views(frames, poses, chosen, device, resolution=keys.resolution)
        for chosen in (training, np.zeros_like(training))
    )
    start = starting_gaussians(
        poses,
        views,
        max_points=_MAX_POINTS,
        densify_init=True,
        sh_degree=0,
        near_plane=keys.near_plane,
        seed=keys.seed,
    )
    options = TrainingOptions(
        render=_settings(keys),
        iterations=keys.iterations,
        max_gaussians=_MAX_GAUSSIANS,
        grow_grad2d=GROW_GRAD2D,
        evaluate_every=keys.iterations,
        seed=keys.seed,
    )
    corrections = make_corrections(keys, start, views, keys.near_plane, keys.iterations)
    extent = scene_extent(views.camera_to_world, keys.near_plane)
    state = TrainingState(start, options, extent, L1Ssim(ssim_lambda=0.2), corrections)
    # Sums over several threads on a CPU would differ from run to run.
    with single_thread():
        resume_and_train(state, ViewSets(views, held_out=none), options, Checkpoint(output, key))
    gaussians, cameras = state.gaussians.detach(), poses.read("camera_to_world")
    if corrections is not None:
        cameras = corrected_poses(cameras, corrections.values_at(np.arange(len(cameras))))
        views = applied(views, corrections.values, corrections.compression)
    return Geometry(gaussians.select(gaussians.finite()), views, cameras, options.render)


def given_geometry(
    frames: Artifact, poses: Artifact, splats: Artifact, training: Mask, keys: InstancesOptions
) -> Geometry:
    """The scene's Gaussians, with the views and poses of their training."""
    device = training_device(keys.backend)
    views = read_views(frames, poses, training, device, resolution=keys.resolution)
    cameras = camera_poses(poses, splats)
    views = replace(views, camera_to_world=cameras[views.frame])
    return Geometry(read_gaussians(splats).to(device), views, cameras, _settings(keys))


def _settings(keys: InstancesOptions) -> RenderSettings:
    return RenderSettings(keys.near_plane, background="black", antialiased=False, backend=keys.backend)

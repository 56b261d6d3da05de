"""Gaussians that masks are merged on: those of the scene, or temporary ones."""

from dataclasses import replace
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
from egosplat.geometry import Camera
from egosplat.instances.options import InstancesOptions

# Comparing masks needs surfaces, not texture: fewer Gaussians than a render, of one color each.
_MAX_POINTS = 40_000
_MAX_GAUSSIANS = 60_000


def train_geometry(
    frames: Artifact,
    poses: Artifact,
    training: Mask,
    keys: InstancesOptions,
    output: Path,
    key: str,
) -> tuple[Gaussians, Views, NDArray[np.float64]]:
    """Train Gaussians for a short time at the working size, on all pixels. A killed run resumes from its checkpoint.

    Args:
        frames, poses: artifacts.
        training: (F,) bool, frames to train on; all have a pose.
        keys: of the stage.
        output: path of the stage's artifact, next to which the checkpoint is kept.
        key: of the checkpoint.

    Returns:
        Gaussians on the device of the backend that do not require gradients, the training views, and the (F, 4, 4) poses of all frames, NaN without
        one. If poses are refined, these are the refined ones.
    """
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
    options = training_options(keys)
    corrections = make_corrections(keys, start, views, keys.near_plane, keys.iterations)
    extent = scene_extent(views.camera_to_world, keys.near_plane)
    state = TrainingState(start, options, extent, L1Ssim(ssim_lambda=0.2), corrections)
    view_sets = ViewSets(views, held_out=none)
    # Sums over several threads on a CPU would differ from run to run.
    with single_thread():
        resume_and_train(state, view_sets, options, Checkpoint(output, key))
    gaussians = state.gaussians.detach()
    gaussians, cameras = gaussians.select(gaussians.finite()), poses.read("camera_to_world")
    if corrections is None:
        return gaussians, views, cameras
    every = corrections.values_at(np.arange(len(cameras)))
    return (
        gaussians,
        applied(views, corrections.values, corrections.compression),
        corrected_poses(cameras, every),
    )


def given_geometry(
    frames: Artifact, poses: Artifact, splats: Artifact, training: Mask, keys: InstancesOptions
) -> tuple[Gaussians, Views, NDArray[np.float64]]:
    """The scene's Gaussians, with the views and poses of their training; arguments and result as ``train_geometry``."""
    device = training_device(keys.backend)
    views = read_views(frames, poses, training, device, resolution=keys.resolution)
    cameras = camera_poses(poses, splats)
    return read_gaussians(splats).to(device), replace(views, camera_to_world=cameras[views.frame]), cameras


def nearest_pixels(size: tuple[int, int], camera: Camera) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Index that samples an array of ``size`` (H, W) at the pixels of ``camera``: (h, 1) rows and (w,) columns."""
    rows, columns = (
        ((np.arange(small) + 0.5) * large / small).astype(np.intp)
        for small, large in zip((camera.height, camera.width), size, strict=True)
    )
    return rows[:, None], columns


def training_options(keys: InstancesOptions) -> TrainingOptions:
    """Return the training options of the temporary Gaussians."""
    return TrainingOptions(
        render=RenderSettings(keys.near_plane, background="black", antialiased=False, backend=keys.backend),
        iterations=keys.iterations,
        max_gaussians=_MAX_GAUSSIANS,
        grow_grad2d=GROW_GRAD2D,
        evaluate_every=keys.iterations,
        seed=keys.seed,
    )

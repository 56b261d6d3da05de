"""Time of a whole training iteration."""

from functools import lru_cache

import numpy as np
import torch

from benchmarks.rasterizer.scenes import NEAR_PLANE, SCENES, Scene, channels, make_scene
from benchmarks.rasterizer.timing import sample
from egosplat.gaussians import trainer as train
from egosplat.gaussians.loss import L1Ssim
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.optimizer import Adam, LearningRates
from egosplat.gaussians.render import RenderSettings, render
from egosplat.gaussians.schedule import Schedule, TrainingOptions
from egosplat.gaussians.trainer import TrainingState
from egosplat.gaussians.training_views import Views
from egosplat.geometry import Camera

_SH_CONSTANT = 0.28209479
_SH_COEFFICIENTS = 16
_NO_DENSITY_CONTROL = Schedule(densify_from=30_000, densify_until=30_000, reset_every=None, sh_interval=1)
_OPTIONS = TrainingOptions(
    render=RenderSettings(near_plane=NEAR_PLANE, background="black", backend="cpu"),
    iterations=30_000,
    max_gaussians=1_000_000,
    evaluate_every=30_000,
    seed=0,
)


class Training:
    """Training with learning rates of zero: the scene does not change, so every iteration costs the same."""

    def __init__(self, scene: Scene, features: int) -> None:
        gaussians = _gaussians(scene, features)
        self.views = _views(scene, gaussians)
        self.state = TrainingState(gaussians, _OPTIONS, extent=0.0, objective=L1Ssim(0.2))
        self.state.optimizer = Adam(gaussians, LearningRates(*[0.0] * 7))
        # From this iteration on, all SH coefficients are in use.
        self.state.iteration = 3

    def iterate(self) -> None:
        """One iteration."""
        train.iterate(self.state, self.views, _NO_DENSITY_CONTROL)


def sample_iteration(scene: str) -> float:
    """Processor time of one iteration [ms]."""
    training = _training(scene)
    return sample(training.iterate)


@lru_cache(maxsize=1)
def _training(scene: str) -> Training:
    training = Training(make_scene(*SCENES[scene]), 0)
    # One pass over the views, so that every visible Gaussian has Adam moments.
    for _ in range(len(training.views)):
        training.iterate()
    return training


def _gaussians(scene: Scene, features: int) -> Gaussians:
    noise = torch.Generator().manual_seed(0)
    sh = 0.05 * torch.randn(len(scene.means), _SH_COEFFICIENTS, 3, generator=noise)
    sh[:, 0] = (scene.colors - 0.5) / _SH_CONSTANT
    return Gaussians(
        means=scene.means.clone(),
        quats=scene.quats.clone(),
        log_scales=scene.scales.log(),
        logit_opacities=scene.opacities.logit(),
        sh=sh,
        features=channels(scene, 3 + features)[:, 3:].contiguous(),
    )


def _views(scene: Scene, gaussians: Gaussians) -> Views:
    """Frames from all cameras: renderings of the scene with noise, so that the loss is not zero."""
    camera = Camera.from_matrix(scene.K.double().numpy(), scene.width, scene.height)
    camera_to_world = np.linalg.inv(scene.viewmats.double().numpy())
    noise = torch.Generator().manual_seed(1)
    pictures = []
    for pose in camera_to_world:
        image, _, _ = render(gaussians, camera, pose, _OPTIONS.render, sh_degree=3, background=None)
        seen = image[..., :3] + 0.05 * torch.randn(camera.height, camera.width, 3, generator=noise)
        pictures.append((255.0 * seen.clamp(0.0, 1.0)).round().to(torch.uint8))
    frame = np.arange(len(pictures), dtype=np.int64)
    return Views(frame, torch.stack(pictures), camera_to_world, None, None, camera, torch.device("cpu"))

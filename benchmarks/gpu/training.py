"""Training of Gaussians: the stage ``splats``, and gsplat's own trainer, on the same views from the same start."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import torch
from torch import Tensor

from benchmarks.common import markdown
from egosplat.artifacts.reader import open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES, SPLATS
from egosplat.gaussians.evaluation import evaluate, mean_known
from egosplat.gaussians.initialization import scene_extent, starting_gaussians
from egosplat.gaussians.loss import torch_l1_ssim
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings, TrainedScene
from egosplat.gaussians.schedule import TrainingOptions
from egosplat.gaussians.training_views import Views, read_views, split_views
from egosplat.geometry import invert
from egosplat.progress import track
from egosplat.rasterize.api import training_device
from egosplat.rasterize.contract import MAX_SH_DEGREE
from egosplat.splats import stage as splats
from egosplat.splats.options import SplatsOptions

ITERATIONS, EVALUATE_EVERY = 7000, 500

# Of the stage: nothing is masked or corrected, as in gsplat's trainer.
OPTIONS = SplatsOptions(refine_poses="off", compensate_exposure="off", masking="none")
# More Gaussians than gsplat's trainer makes of these views.
UNLIMITED = 5_000_000

# gsplat's trainer (gsplat 1.5.3, its example simple_trainer): learning rates, with that of the means in scene extents.
RATES = {"means": 1.6e-4, "scales": 5e-3, "quats": 1e-3, "opacities": 5e-2, "sh0": 2.5e-3, "shN": 1.25e-4}
MEANS_DECAY = 0.01
SH_EVERY = 1000
SSIM = 0.2
EPS = 1e-15

# Renders like ``gsplat.rasterization``.
Rasterize = Callable[..., tuple[Tensor, Tensor, dict[str, Any]]]


@dataclass(frozen=True)
class Curve:
    """A training run.

    Attributes:
        iterations: of the whole run; gaussians: at its end.
        seconds: training time until each evaluation; psnr: mean over held-out views at each [dB].
    """

    iterations: int
    gaussians: int
    seconds: tuple[float, ...]
    psnr: tuple[float, ...]

    def seconds_to(self, psnr: float) -> float | None:
        """Training time until the first evaluation that reaches a PSNR; None if none does."""
        return next((s for s, one in zip(self.seconds, self.psnr, strict=True) if one >= psnr), None)


def report(gsplat: ModuleType, scene: Path, work: Path, iterations: int = ITERATIONS) -> str:
    """Train on a finished scene and return the table, in Markdown.

    Args:
        scene: folder with the artifacts frames and poses.
        work: folder for the Gaussians that the stage writes.
    """
    frames, poses = scene / "frames.zarr", scene / "poses.zarr"
    every = min(EVALUATE_EVERY, iterations)
    limited = {"iterations": iterations, "evaluate_every": every}
    most = OPTIONS.max_gaussians
    curves = {
        f"egosplat, at most {most:,} Gaussians": of_stage(frames, poses, work / "limited.zarr", limited),
        "egosplat, no limit": of_stage(
            frames, poses, work / "unlimited.zarr", limited | {"max_gaussians": UNLIMITED}
        ),
        "gsplat's trainer": of_gsplat(gsplat.rasterization, frames, poses, iterations, every),
    }
    return table(curves)


def table(curves: Mapping[str, Curve]) -> str:
    """A row for each run, with its time to the PSNR that all of them reach."""
    common = min(curve.psnr[-1] for curve in curves.values())
    rows = []
    for name, curve in curves.items():
        seconds = curve.seconds_to(common)
        rows.append(
            [
                name,
                f"{curve.iterations / curve.seconds[-1]:.0f}",
                f"{curve.gaussians:,}",
                f"{curve.psnr[-1]:.2f}",
                "-" if seconds is None else f"{seconds:.0f}",
            ]
        )
    columns = [
        "trainer",
        "iterations a second",
        "Gaussians",
        "held-out PSNR [dB]",
        f"time to {common:.2f} dB [s]",
    ]
    return markdown(columns, rows)


def of_stage(frames: Path, poses: Path, output: Path, changed: Mapping[str, Any]) -> Curve:
    """Run the stage ``splats`` with changed keys."""
    splats.run(frames, poses, output, OPTIONS.change(**changed))
    artifact = open_artifact(output, SPLATS)
    return Curve(
        artifact.facts["iteration"],
        artifact.shape("means")[0],
        tuple(artifact.facts["history_s"]),
        tuple(artifact.read("history/psnr").tolist()),
    )


def of_gsplat(
    rasterize: Rasterize, frames_path: Path, poses_path: Path, iterations: int, every: int
) -> Curve:
    """Train as gsplat's own trainer does, with its density control and PyTorch's Adam.

    It differs from the example in that the SSIM is egosplat's in plain PyTorch, and that the Gaussians start where the
    stage ``splats`` starts them. Milestones are those of a run of 30,000 iterations, as in the example.
    """
    frames, poses = open_artifact(frames_path, FRAMES), open_artifact(poses_path, POSES)
    device = training_device(OPTIONS.backend)
    views, held_out = (read_views(frames, poses, rows, device) for rows in split_views(frames, poses))
    most = {"max_points": OPTIONS.max_points, "max_gaussians": OPTIONS.max_gaussians}
    options = TrainingOptions.of(OPTIONS, evaluate_every=every, sh_degree=MAX_SH_DEGREE, **most)
    start = starting_gaussians(poses, views, options)
    return GsplatTraining(rasterize, views, start, iterations).run(held_out, every)


def _sh_degree(step: int) -> int:
    """Active degree of the spherical harmonics after ``step`` iterations."""
    return min(step // SH_EVERY, MAX_SH_DEGREE)


class GsplatTraining:
    """gsplat's trainer: one Adam for each parameter, and ``gsplat.DefaultStrategy``."""

    def __init__(self, rasterize: Rasterize, views: Views, start: Gaussians, iterations: int) -> None:
        from gsplat import DefaultStrategy

        self._rasterize, self._views, self._iterations = rasterize, views, iterations
        extent = scene_extent(views.camera_to_world)
        tensors = {
            "means": start.means,
            "scales": start.log_scales,
            "quats": start.quats,
            "opacities": start.logit_opacities,
            "sh0": start.sh[:, :1],
            "shN": start.sh[:, 1:],
        }
        self._parameters = {name: torch.nn.Parameter(value.clone()) for name, value in tensors.items()}
        rates = RATES | {"means": RATES["means"] * extent}
        self._optimizers = {
            name: torch.optim.Adam([value], lr=rates[name], eps=EPS)
            for name, value in self._parameters.items()
        }
        self._decay = torch.optim.lr_scheduler.ExponentialLR(
            self._optimizers["means"], gamma=MEANS_DECAY ** (1 / iterations)
        )
        self._strategy = DefaultStrategy()
        self._strategy.check_sanity(self._parameters, self._optimizers)
        self._state = self._strategy.initialize_state(scene_scale=extent)
        device = views.device
        self._cameras = (
            torch.from_numpy(np.stack([invert(pose) for pose in views.camera_to_world])).float().to(device)
        )
        self._matrix = torch.from_numpy(views.camera.matrix).float().to(device)[None]

    def run(self, held_out: Views, every: int) -> Curve:
        """Train, and evaluate after each ``every`` iterations."""
        settings = RenderSettings(OPTIONS.near_plane, "black", backend=OPTIONS.backend)
        seconds, psnr, spent = [], [], 0.0
        generator = torch.Generator().manual_seed(OPTIONS.seed)
        began = time.perf_counter()
        order: list[int] = []
        for step in track(range(self._iterations), "gsplat's trainer"):
            if not order:
                order = torch.randperm(len(self._views), generator=generator).tolist()
            self._iterate(step, order.pop())
            if (step + 1) % every == 0 or step + 1 == self._iterations:
                self._wait()
                spent += time.perf_counter() - began
                degree = _sh_degree(step)
                seconds.append(spent)
                scene = TrainedScene(self._gaussians, settings, held_out.camera, degree)
                psnr.append(mean_known(evaluate(scene, held_out)[0]))
                self._wait()
                began = time.perf_counter()
        return Curve(self._iterations, len(self._parameters["means"]), tuple(seconds), tuple(psnr))

    def _iterate(self, step: int, index: int) -> None:
        values, camera = self._parameters, self._views.camera
        image, _, info = self._rasterize(
            means=values["means"],
            quats=values["quats"],
            scales=values["scales"].exp(),
            opacities=values["opacities"].sigmoid(),
            colors=torch.cat([values["sh0"], values["shN"]], dim=1),
            viewmats=self._cameras[index][None],
            Ks=self._matrix,
            width=camera.width,
            height=camera.height,
            near_plane=OPTIONS.near_plane,
            sh_degree=_sh_degree(step),
            packed=False,
        )
        following = (self._parameters, self._optimizers, self._state, step, info)
        self._strategy.step_pre_backward(*following)
        weight = self._views.weight(index)
        torch_l1_ssim(image[0], self._views.picture(index), weight, SSIM).backward()
        for optimizer in self._optimizers.values():
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        self._decay.step()
        self._strategy.step_post_backward(*following, packed=False)

    @property
    def _gaussians(self) -> Gaussians:
        values = {name: value.detach() for name, value in self._parameters.items()}
        return Gaussians(
            means=values["means"],
            quats=values["quats"],
            log_scales=values["scales"],
            logit_opacities=values["opacities"],
            sh=torch.cat([values["sh0"], values["shN"]], dim=1),
            features=values["means"].new_zeros(len(values["means"]), 0),
        )

    def _wait(self) -> None:
        """Wait until the GPU has computed what was asked of it."""
        if self._views.device.type == "cuda":
            torch.cuda.synchronize()

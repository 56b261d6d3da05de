"""Stage ``splats``: 3D Gaussians from pictures and poses."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from egosplat.artifacts import provenance
from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.features import FEATURES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.kept_frames import frames_for_gaussians
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.provenance import Provenance
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.splats import SPLATS
from egosplat.artifacts.writer import create
from egosplat.codes.joint_objective import JointLanguage, with_codes
from egosplat.codes.targets import CodeTargets
from egosplat.errors import UserError
from egosplat.gaussians.device import rasterizer_used, training_device
from egosplat.gaussians.evaluation import Scores, evaluate
from egosplat.gaussians.initialization import scene_extent
from egosplat.gaussians.io import put_curves, put_gaussians
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.objective import L1Ssim, Objective
from egosplat.gaussians.options import TrainingOptions
from egosplat.gaussians.pixel_weights import Masking, open_masking
from egosplat.gaussians.render import RenderSettings
from egosplat.gaussians.starting_points import starting_gaussians
from egosplat.gaussians.trainer import Photographs, resume_and_train
from egosplat.gaussians.training_state import TrainingState
from egosplat.gaussians.training_views import (
    Mask,
    Split,
    Views,
    read_views,
    set_aside,
    split_views,
)
from egosplat.progress import log
from egosplat.rasterize.contract import MAX_SH_DEGREE


@dataclass(frozen=True)
class SplatsOptions:
    """The schema's keys of ``splats``; ``config.schema.yaml`` describes each."""

    masking: str
    language: str
    feature_weight: float
    iterations: int
    strategy: str
    max_points: int
    densify_init: bool
    max_gaussians: int
    sh_degree: int | str
    ssim_lambda: float
    position_lr: float
    grow_grad2d: float
    reset_opacity: float
    reset_at_start: bool
    prune_screen_px: float | None
    near_plane: float
    background: str
    antialiased: bool
    evaluate_every: int
    patience: int
    min_improvement: float
    checkpoint_s: float
    backend: str
    seed: int

    @property
    def training(self) -> TrainingOptions:
        """How the Gaussians are trained."""
        return TrainingOptions(
            render=RenderSettings(
                near_plane=self.near_plane,
                background=self.background,
                antialiased=self.antialiased,
                backend=self.backend,
            ),
            iterations=self.iterations,
            strategy=self.strategy,
            max_gaussians=self.max_gaussians,
            position_lr=self.position_lr,
            grow_grad2d=self.grow_grad2d,
            reset_opacity=self.reset_opacity,
            reset_at_start=self.reset_at_start,
            prune_screen_px=self.prune_screen_px,
            evaluate_every=self.evaluate_every,
            patience=self.patience,
            min_improvement=self.min_improvement,
            seed=self.seed,
            searches_degree=self.sh_degree == "auto",
        )


def run(
    frames: Path,
    poses: Path,
    output: Path,
    options: SplatsOptions,
    *,
    survey: Path | None = None,
    transient: Path | None = None,
    masks: Path | None = None,
    segments: Path | None = None,
    features: Path | None = None,
) -> None:
    """Write the splats artifact of ``frames`` with ``poses``.

    A run that was killed goes on from its last checkpoint, to the same Gaussians as without the kill.

    Args:
        frames, poses, output: paths.
        survey: the frames that it leaves out are not trained on, but where nothing moves and nothing is masked.
        transient: needed where ``masking`` is ``initial``; masks: where it is ``refined``.
        segments, features: needed where ``language`` is ``joint``.

    Raises:
        UserError: no training frame has a pose, an input lacks or does not belong to the others, the backend
            cannot run, training diverges.
    """
    pictures, walk = open_artifact(frames, FRAMES), open_artifact(poses, POSES)
    kept, by_survey = frames_for_gaussians(pictures, survey, options.masking)
    moving = open_masking(options.masking, pictures, transient=transient, masks=masks)
    words = _words(segments, features) if options.language == "joint" else ()
    made = _begin(asdict(options) | by_survey, pictures, walk, moving, words)
    photographs = _photographs(pictures, walk, kept, moving, options.training)
    start = starting_gaussians(
        walk,
        photographs.training,
        max_points=min(options.max_points, options.max_gaussians),
        densify_init=options.densify_init,
        sh_degree=MAX_SH_DEGREE if isinstance(options.sh_degree, str) else options.sh_degree,
        near_plane=options.near_plane,
        seed=options.seed,
    )
    objective: Objective = L1Ssim(options.ssim_lambda)
    if words:
        targets = CodeTargets(*words, photographs.training.device)
        objective = JointLanguage(options.ssim_lambda, options.feature_weight, targets)
        start = replace(start, features=with_codes(start.count, targets, start.means.device))
    checkpoint = Checkpoint(output, provenance.key_of(made), options.checkpoint_s)
    state = _trained(start, photographs, options.training, objective, checkpoint)
    _write(output, made, state, photographs, options.training)
    checkpoint.remove()


def _words(segments: Path | None, features: Path | None) -> tuple[Artifact, Artifact]:
    if segments is None or features is None:
        raise UserError(
            "splats.language = joint needs what codes are made from: give --segments and --features"
        )
    return open_artifact(segments, SEGMENTS), open_artifact(features, FEATURES)


def _begin(
    keys: dict[str, Any], pictures: Artifact, walk: Artifact, moving: Masking, words: tuple[Artifact, ...]
) -> Provenance:
    check_made_from(walk, pictures, axes=("frame",))
    used = [pictures, walk, *words]
    if moving.artifact is not None:
        used.append(moving.artifact)
    return provenance.begin_from("splats", keys, used)


def _photographs(
    pictures: Artifact, walk: Artifact, kept: Mask, moving: Masking, options: TrainingOptions
) -> Photographs:
    """What moves is left out of training and of what decides its end; held-out pictures are measured whole."""
    flags = pictures.read("train") & kept, pictures.read("evaluation"), walk.read("registered")
    split = split_views(*flags, validate=options.patience > 0)
    device = training_device(options.render.backend)
    photographs = Photographs(
        read_views(pictures, walk, split.training, moving, device),
        read_views(pictures, walk, split.validation, moving, device),
        read_views(pictures, walk, split.held_out, Masking(None, ""), device),
        read_views(pictures, walk, _judging(split, options), moving, device),
    )
    _check_left(photographs.training)
    counts = ", ".join(f"{len(views)} {name}" for name, views in _named(photographs).items())
    log(f"views: {counts}; on {rasterizer_used(options.render.backend, device)}")
    return photographs


def _judging(split: Split, options: TrainingOptions) -> Mask:
    """The frames that judge the SH degree: those that validate, or else some of those to train on."""
    if not options.searches_degree:
        return np.zeros_like(split.training)
    if split.validation.any():
        return split.validation
    return set_aside(split.training, "splats.sh_degree = auto", "a number from 0 to 3")


def _check_left(views: Views) -> None:
    weights = (views.weight(index) for index in range(len(views)))
    if not any(weight is None or bool(weight.any()) for weight in weights):
        raise UserError(
            "splats.masking: leaves no pixel of any training frame; raise masks.threshold, or set it to none"
        )


def _named(photographs: Photographs) -> dict[str, Any]:
    return {
        "training": photographs.training,
        "validation": photographs.validation,
        "held out": photographs.held_out,
    }


def _trained(
    start: Gaussians,
    photographs: Photographs,
    options: TrainingOptions,
    objective: Objective,
    checkpoint: Checkpoint,
) -> TrainingState:
    """The state after training."""
    extent = scene_extent(photographs.training.camera_to_world)
    state = TrainingState(start, options, extent, objective)
    resume_and_train(state, photographs, options, checkpoint)
    return state


def _write(
    output: Path,
    made: Provenance,
    state: TrainingState,
    photographs: Photographs,
    options: TrainingOptions,
) -> None:
    """Evaluate what is kept: the best Gaussians where early stopping is on, else the last."""
    kept = state.early_stop.best
    gaussians, iteration = (
        (state.gaussians, state.iteration) if kept is None else (kept, state.early_stop.best_iteration)
    )
    held_out = photographs.held_out
    camera = held_out.camera
    with create(output, SPLATS, made) as artifact:
        artifact.allocate("held_out/render", (len(held_out), camera.height, camera.width, 3))
        scores = evaluate(
            gaussians,
            held_out,
            options.render,
            options.schedule.sh_degree(iteration, gaussians.sh_degree),
            lambda index, picture: artifact.put_row("held_out/render", index, picture),
        )
        put_gaussians(artifact, gaussians)
        put_curves(artifact, state.curves)
        artifact.put("held_out/frame", held_out.frame)
        artifact.put("held_out/psnr", scores.psnr)
        artifact.put("held_out/ssim", scores.ssim)
        artifact.facts = _facts(state, gaussians, photographs, options, iteration)
    log(f"{gaussians.count} Gaussians of iteration {iteration}; held out: {_summary(scores)}")


def _summary(scores: Scores) -> str:
    if not len(scores.psnr):
        return "no frame"
    return f"PSNR {scores.mean_psnr:.2f} dB, SSIM {scores.mean_ssim:.3f}"


def _facts(
    state: TrainingState,
    gaussians: Gaussians,
    photographs: Photographs,
    options: TrainingOptions,
    iteration: int,
) -> dict[str, Any]:
    views = photographs.training
    return {
        "camera": asdict(views.camera),
        "rasterizer": rasterizer_used(options.render.backend, views.device),
        "extent_m": state.extent,
        "views": {name: len(some) for name, some in _named(photographs).items()},
        "iteration": iteration,
        "iterations_done": state.iteration,
        "stopped_early": state.iteration < options.iterations,
        "sh_degree_in_use": options.schedule.sh_degree(iteration, gaussians.sh_degree),
        "sh_degree_psnr": state.degree_search.psnr,
        "skipped_rows": state.optimizer.skipped_rows,
        "training_s": round(state.seconds, 3),
        "history_s": state.curves.seconds,
    }

"""Stage ``language``: what each Gaussian means, at every level."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from egosplat.artifacts import provenance
from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.features import FEATURES
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.kept_frames import kept_frames
from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.provenance import Provenance
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.segments import SEGMENTS
from egosplat.artifacts.splats import SPLATS
from egosplat.artifacts.writer import create
from egosplat.codes.targets import CodeTargets
from egosplat.errors import UserError
from egosplat.gaussians.device import training_device
from egosplat.gaussians.io import read_gaussians, read_render_settings
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.pixel_weights import Masking, open_masking
from egosplat.gaussians.render import RenderSettings
from egosplat.language.lifting import Lifted, lift
from egosplat.language.training import CodeOptions, CodeTraining, Curve, shown_codes
from egosplat.language.views import TaughtViews, taught_views
from egosplat.progress import log


@dataclass(frozen=True)
class LanguageOptions:
    """The schema's keys of ``language``; ``config.schema.yaml`` describes each."""

    method: str
    iterations: int
    lr: float
    normalize_codes: bool
    checkpoint_s: float
    backend: str
    seed: int


def run(
    frames: Path,
    poses: Path,
    segments: Path,
    features: Path,
    splats: Path,
    output: Path,
    options: LanguageOptions,
    *,
    survey: Path | None = None,
    transient: Path | None = None,
    masks: Path | None = None,
) -> None:
    """Write the language artifact of ``splats``.

    Where the codes were trained with the geometry, they are taken as they are, whatever the method. Pixels of what
    moves weigh as in the training of the splats, and need the same artifact.

    Args:
        frames, poses, segments, features, splats, output: paths.
        survey: of the frames that it leaves out nothing is learned.
        transient: needed where the splats' masking is ``initial``; masks: where it is ``refined``.

    Raises:
        UserError: an input lacks or does not belong to the others, the backend cannot run, training diverges.
    """
    pictures, walk = open_artifact(frames, FRAMES), open_artifact(poses, POSES)
    instances, words = open_artifact(segments, SEGMENTS), open_artifact(features, FEATURES)
    scene = open_artifact(splats, SPLATS)
    check_made_from(walk, pictures, axes=("frame",))
    moving = open_masking(scene.provenance["options"]["masking"], pictures, transient=transient, masks=masks)
    kept, by_survey = kept_frames(pictures, survey)
    made = _begin(asdict(options) | by_survey, [pictures, walk, instances, words, scene], moving)
    device = training_device(options.backend)
    targets = CodeTargets(instances, words, device)
    views = taught_views(pictures, walk, targets.of, moving, device, kept)
    gaussians = read_gaussians(scene).to(device)
    settings = read_render_settings(scene, options.backend)
    lifted = lift(gaussians, views, settings)
    checkpoint = Checkpoint(output, provenance.key_of(made), options.checkpoint_s)
    method, code, curve = options.method, lifted.code, Curve()
    if _is_joint(scene):
        method, code = "joint", _joint_codes(scene, words, lifted)
    elif method == "trained":
        code, curve = _trained(gaussians, views, settings, lifted, _training(options), checkpoint)
    facts = {"levels": targets.levels, "method": method, "views": len(views)}
    _write(output, made, code, lifted.share, curve, facts)
    checkpoint.remove()


def _begin(keys: dict[str, Any], used: list[Artifact], moving: Masking) -> Provenance:
    if moving.artifact is not None:
        used = [*used, moving.artifact]
    return provenance.begin_from("language", keys, used)


def _training(options: LanguageOptions) -> CodeOptions:
    return CodeOptions(
        iterations=options.iterations,
        lr=options.lr,
        normalize_codes=options.normalize_codes,
        seed=options.seed,
    )


def _is_joint(splats: Artifact) -> bool:
    return splats.provenance["options"]["language"] == "joint"


def _joint_codes(splats: Artifact, features: Artifact, lifted: Lifted) -> Tensor:
    """The codes that the splats were trained with, as they were rendered there: of any norm (docs/method.md#code-norm).

    Raises:
        UserError: they were trained with other features.
    """
    check_made_from(splats, features)
    stored = torch.from_numpy(splats.read("features")).to(lifted.code.device)
    return stored.reshape(lifted.code.shape)


def _trained(
    gaussians: Gaussians,
    views: TaughtViews,
    settings: RenderSettings,
    lifted: Lifted,
    options: CodeOptions,
    checkpoint: Checkpoint,
) -> tuple[Tensor, Curve]:
    """A run that was killed goes on from its last checkpoint; an error of the user's removes it."""
    training = CodeTraining(gaussians, *lifted.code.shape[1:], options)
    if (saved := checkpoint.load()) is not None:
        training.load_state_dict(saved)
        log(f"training of codes goes on after iteration {training.iteration}")
    try:
        training.run(gaussians, views, settings, checkpoint)
    except UserError:
        checkpoint.remove()
        raise
    return shown_codes(training.code.detach(), options.normalize_codes), training.curve


def _write(
    output: Path, made: Provenance, code: Tensor, share: Tensor, curve: Curve, facts: dict[str, Any]
) -> None:
    taught = share > 0
    code = torch.where(taught[..., None], code, 0.0)
    with create(output, LANGUAGE, made) as artifact:
        artifact.put("code", code.cpu().numpy())
        artifact.put("share", share.cpu().numpy())
        artifact.put("curve/iteration", np.array(curve.iteration, np.int64))
        artifact.put("curve/loss", np.array(curve.loss, np.float64))
        artifact.facts = facts
    shares = ", ".join(
        f"{name} {float(part):.0%}"
        for name, part in zip(facts["levels"], taught.float().mean(0), strict=True)
    )
    log(f"Gaussians with a meaning: {shares}")

"""Stage ``language``: give each Gaussian a language code at every level."""

from dataclasses import asdict, dataclass, replace
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
from egosplat.artifacts.instances import INSTANCES
from egosplat.artifacts.kept_frames import kept_frames
from egosplat.artifacts.language import LANGUAGE
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.provenance import Provenance
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.splats import SPLATS, camera_poses
from egosplat.artifacts.writer import create
from egosplat.codes.targets import CodeTargets
from egosplat.errors import UserError
from egosplat.gaussians.device import training_device
from egosplat.gaussians.io import read_gaussians, read_render_settings
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.pixel_weights import open_masking
from egosplat.gaussians.render import RenderSettings
from egosplat.language.lifting import Lifted, lift
from egosplat.language.training import CodeOptions, CodeTraining, Curve, codes_to_render
from egosplat.language.views import CodeViews, select_code_views
from egosplat.progress import log


@dataclass(frozen=True)
class LanguageOptions(CodeOptions):
    """Configuration keys of the stage; ``config.schema.yaml`` describes each."""

    method: str
    checkpoint_s: float
    backend: str


def run(
    frames_path: Path,
    poses_path: Path,
    instances_path: Path,
    features_path: Path,
    splats_path: Path,
    output: Path,
    options: LanguageOptions,
    *,
    survey_path: Path | None = None,
    transient_path: Path | None = None,
    masks_path: Path | None = None,
) -> None:
    """Write the language artifact of ``splats``.

    Codes of joint training are copied, whatever the method. Transient pixels are masked as in the training of the
    splats, which needs the same artifact.

    Args:
        survey_path: excludes frames from training.
        transient_path: required if the splats' masking is ``initial``.
        masks_path: required if the splats' masking is ``refined``.

    Raises:
        UserError: an input is missing or does not belong to the others, the backend cannot run, or training
            diverges.
    """
    frames, poses = open_artifact(frames_path, FRAMES), open_artifact(poses_path, POSES)
    instances, features = open_artifact(instances_path, INSTANCES), open_artifact(features_path, FEATURES)
    splats = open_artifact(splats_path, SPLATS)
    check_made_from(poses, frames, axes=("frame",))
    masking = open_masking(
        splats.provenance["options"]["masking"], frames, transient_path=transient_path, masks_path=masks_path
    )
    kept, by_survey = kept_frames(frames, survey_path)
    used = [frames, poses, instances, features, splats, *masking.artifacts]
    record = provenance.begin_from("language", asdict(options) | by_survey, used)
    device = training_device(options.backend)
    targets = CodeTargets(instances, features, device)
    views = select_code_views(frames, poses, targets.of, masking, device, kept)
    views = replace(views, camera_to_world=camera_poses(poses, splats)[views.frame])
    gaussians = read_gaussians(splats).to(device)
    settings = read_render_settings(splats, options.backend)
    # Every method needs the shares, which only lifting computes.
    lifted = lift(gaussians, views, settings)
    checkpoint = Checkpoint(output, provenance.key_of(record), options.checkpoint_s)
    method, code, curve = options.method, lifted.code, Curve()
    if _is_joint(splats):
        method, code = "joint", _joint_codes(splats, features, lifted)
    elif method == "trained":
        code, curve = _trained(gaussians, views, settings, lifted, options, checkpoint)
    facts = {"levels": targets.levels, "method": method, "views": len(views)}
    _write(output, record, code, lifted.share, curve, facts)
    checkpoint.remove()


def _is_joint(splats: Artifact) -> bool:
    return splats.provenance["options"]["language"] == "joint"


def _joint_codes(splats: Artifact, features: Artifact, lifted: Lifted) -> Tensor:
    """Read the codes that the splats were trained with, unnormalized, as rendered there (docs/method.md#code-norm).

    Raises:
        UserError: they were trained with other features.
    """
    check_made_from(splats, features)
    stored = torch.from_numpy(splats.read("features")).to(lifted.code.device)
    return stored.reshape(lifted.code.shape)


def _trained(
    gaussians: Gaussians,
    views: CodeViews,
    settings: RenderSettings,
    lifted: Lifted,
    options: CodeOptions,
    checkpoint: Checkpoint,
) -> tuple[Tensor, Curve]:
    """Train codes, from the last checkpoint if there is one. A UserError removes the checkpoint."""
    training = CodeTraining(gaussians, *lifted.code.shape[1:], options)
    if (saved := checkpoint.load()) is not None:
        training.load_state_dict(saved)
        log(f"training of codes resumes after iteration {training.iteration}")
    try:
        training.run(gaussians, views, settings, checkpoint)
    except UserError:
        # Resuming would diverge again.
        checkpoint.remove()
        raise
    # Stored as they are rendered, so that queries need not know whether codes are normalized.
    return codes_to_render(training.code.detach(), options.normalize_codes), training.curve


def _write(
    output: Path, record: Provenance, code: Tensor, share: Tensor, curve: Curve, facts: dict[str, Any]
) -> None:
    labeled = share > 0
    # Gaussians that no labeled pixel shows have no code.
    code = torch.where(labeled[..., None], code, 0.0)
    with create(output, LANGUAGE, record) as artifact:
        artifact.put("code", code.cpu().numpy())
        artifact.put("share", share.cpu().numpy())
        artifact.put("curve/iteration", np.array(curve.iteration, np.int64))
        artifact.put("curve/loss", np.array(curve.loss, np.float64))
        artifact.facts = facts
    shares = ", ".join(
        f"{name} {float(part):.0%}"
        for name, part in zip(facts["levels"], labeled.float().mean(0), strict=True)
    )
    log(f"Gaussians with a code: {shares}")

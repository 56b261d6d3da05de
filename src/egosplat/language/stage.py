"""Stage ``language``: give each Gaussian a language code at every level."""

from pathlib import Path
from typing import Any

import numpy as np
import torch

from egosplat.artifacts import provenance
from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.consistency import check_made_from, kept_frames
from egosplat.artifacts.provenance import Provenance
from egosplat.artifacts.reader import open_artifact, open_needed
from egosplat.artifacts.schemas import FRAMES, LANGUAGE, POSES, SPLATS
from egosplat.artifacts.writer import create
from egosplat.gaussians.io import read_gaussians, read_render_settings
from egosplat.gaussians.training_views import open_masking
from egosplat.language.decoder import decoder_metadata
from egosplat.language.method import SEGMENTERS, Coded, Method
from egosplat.language.options import LanguageOptions
from egosplat.language.targets import CodeTargets
from egosplat.language.views import select_code_views
from egosplat.pipeline.stages import load_module
from egosplat.progress import log
from egosplat.rasterize.api import training_device


def run(
    frames_path: Path,
    poses_path: Path,
    splats_path: Path,
    output: Path,
    options: LanguageOptions,
    **more: Path | None,
) -> None:
    """Write the language artifact of ``splats``.

    Codes of joint training are copied, whatever the method. Transient pixels are masked as in the training of the splats,
    which needs the same artifact, ``transient_path`` or ``masks_path``. UserError: an input is missing or does not belong to
    the others, jointly trained codes are of other features, the backend cannot run, or training diverges.

    Args:
        more: paths that some configurations need: ``survey_path`` excludes frames from training; of masks; and
            ``instances_path``, ``features_path`` and ``tiles_path``, what the method learns from.
    """
    frames, poses = open_artifact(frames_path, FRAMES), open_artifact(poses_path, POSES)
    splats = open_artifact(splats_path, SPLATS)
    name = "joint" if splats.provenance["options"]["language"] == "joint" else options.method
    check_made_from(poses, frames, axes=("frame",))
    masking = open_masking(splats.provenance["options"]["masking"], frames, more)
    kept, by_survey = kept_frames(frames, more.get("survey_path"))
    method: Method = load_module("language", name).METHOD
    needed = [(more.get(f"{schema.name}_path"), schema) for schema in method.learns_from]
    learnt_from = open_needed(f"language by method {name}", *needed)
    used = [frames, poses, splats, *masking.artifacts, *learnt_from]
    record = provenance.begin_from("language", options.as_dict() | by_survey, used, chosen=name)
    device = training_device(options.backend)
    targets = method.open_targets(learnt_from, frames, device)
    codes_of = targets.of if isinstance(targets, CodeTargets) else None
    given = read_gaussians(splats).to(device), read_render_settings(splats, options.backend)
    views = select_code_views(frames, poses, splats, codes_of, masking, *given, kept)
    checkpoint = Checkpoint(output, provenance.key_of(record))
    if name == "joint":
        check_made_from(splats, learnt_from[1])
        coded = method.give_codes(views, targets, splats.read("features"))
    else:
        coded = method.give_codes(views, targets, options, checkpoint)
    geometry = f"geometry shared, of {splats.provenance['options']['iterations']:,} iterations"
    if given := splats.facts.get("source"):
        geometry = f"geometry of {given['file']}"
    masks = [method.masks.format(SEGMENTERS[options.segmenter])] if method.masks else []
    stands_in = [*masks, *coded.stands_in, geometry]
    facts = {"method": name, "maps_only": coded.maps_only, "views": len(views), "stands_in": stands_in}
    _write(output, record, coded, facts)
    checkpoint.remove()


def _write(output: Path, record: Provenance, coded: Coded, facts: dict[str, Any]) -> None:
    labeled = coded.share > 0
    # Gaussians that no labeled pixel shows have no code.
    code = torch.where(labeled[..., None], coded.code, 0.0)
    facts = facts | {"levels": coded.levels}
    with create(output, LANGUAGE, record) as artifact:
        artifact.put("code", code.cpu().numpy())
        artifact.put("share", coded.share.cpu().numpy())
        artifact.put("curve/iteration", np.array([iteration for iteration, _ in coded.curve], np.int64))
        artifact.put("curve/loss", np.array([loss for _, loss in coded.curve], np.float64))
        if coded.decoder is not None:
            artifact.put("decoder/values", coded.decoder.values)
            facts["decoder"] = decoder_metadata(coded.decoder)
        artifact.facts = facts
    shares = ", ".join(
        f"{name} {float(part):.0%}" for name, part in zip(coded.levels, labeled.float().mean(0), strict=True)
    )
    log(f"Gaussians with a code: {shares}")

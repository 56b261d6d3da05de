"""Score the Gaussians on the held-out frames, fit those frames, and write the corrections of all frames."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch

from egosplat.artifacts.reader import Artifact
from egosplat.artifacts.schemas import AS_GIVEN, FITTED, INTERPOLATED, TRAINED
from egosplat.artifacts.writer import Writer
from egosplat.gaussians.corrections import LOG_GAIN, Corrections, angle_of, applied, corrected_poses
from egosplat.gaussians.evaluation import Scores, evaluate
from egosplat.gaussians.fitting import fit
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings
from egosplat.gaussians.training_views import Masking, Views
from egosplat.progress import log


def put_held_out(
    artifact: Writer,
    gaussians: Gaussians,
    held_out: Views,
    settings: RenderSettings,
    sh_degree: int,
    suffix: str = "",
) -> Scores:
    """Render the held-out frames and store the renders and their scores; ``suffix`` ends the names of the arrays."""
    camera, render = held_out.camera, f"held_out/render{suffix}"
    artifact.allocate(render, (len(held_out), camera.height, camera.width, 3))
    scores = evaluate(gaussians, held_out, settings, sh_degree, partial(artifact.put_row, render))
    artifact.put(f"held_out/psnr{suffix}", scores.psnr)
    artifact.put(f"held_out/ssim{suffix}", scores.ssim)
    return scores


def put_corrections(
    artifact: Writer,
    corrections: Corrections,
    gaussians: Gaussians,
    held_out: Views,
    settings: RenderSettings,
    sh_degree: int,
    poses: Artifact,
    masking: Masking,
) -> tuple[Views, dict[str, Any]]:
    """Store the corrections of all frames, and the scores of the held-out frames without any.

    A held-out frame is fitted to the Gaussians, which stay as they are: it never trains them.

    Returns:
        The held-out views with their fitted corrections, and facts.
    """
    given = put_held_out(artifact, gaussians, held_out, settings, sh_degree, "_given")
    guess = corrections.values_at(held_out.frame)
    # What moves is not in the Gaussians: it must not pull at the pose. The scores count it.
    unmasked = replace(held_out, transient=masking.frames(held_out.frame))
    found = fit(gaussians, unmasked, guess, corrections, settings, sh_degree)
    registered = np.flatnonzero(poses.read("registered"))
    camera_to_world = poses.read("camera_to_world")
    values = torch.zeros(len(camera_to_world), guess.shape[1], dtype=torch.float64)
    values[registered] = corrections.values_at(registered)
    values[held_out.frame] = found
    source = np.full(len(values), AS_GIVEN, np.int8)
    source[registered] = INTERPOLATED if corrections.smooth else AS_GIVEN
    source[corrections.trained_frames] = TRAINED
    source[held_out.frame] = FITTED
    shift, turn = values[:, :3].numpy(), np.degrees(angle_of(values[:, 3:6]).numpy())
    artifact.put("corrections/camera_to_world", corrected_poses(camera_to_world, values))
    artifact.put("corrections/source", source)
    artifact.put("corrections/shift", shift)
    artifact.put("corrections/turn", turn)
    artifact.put("corrections/gain", values[:, LOG_GAIN].exp().numpy())
    if len(held_out):
        log(
            f"held out as given: PSNR {given.mean_psnr:.2f} dB, SSIM {given.mean_ssim:.3f}; "
            f"poses moved by up to {1e3 * np.linalg.norm(shift, axis=1).max():.1f} mm and {turn.max():.2f} degrees"
        )
    facts = {"scene_depth": corrections.depth, "up": poses.read("up").tolist()}
    facts["highlight_compression"] = float(corrections.compression)
    return applied(held_out, found, corrections.compression), facts

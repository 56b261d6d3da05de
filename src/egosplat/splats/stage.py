"""Stage ``splats``: train 3D Gaussians on frames with poses."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from egosplat.arrays import Bools
from egosplat.artifacts import provenance
from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.consistency import check_made_from, kept_frames
from egosplat.artifacts.provenance import Provenance
from egosplat.artifacts.reader import Artifact, open_artifact, open_needed
from egosplat.artifacts.schemas import (
    AS_GIVEN,
    FEATURES,
    FITTED,
    FRAMES,
    INSTANCES,
    INTERPOLATED,
    POSES,
    SPLATS,
    TRAINED,
    length_unit,
)
from egosplat.artifacts.writer import Writer, create
from egosplat.calibration.files import source_files
from egosplat.errors import UserError
from egosplat.gaussians.corrections import LOG_GAIN, Corrections, applied, corrected_poses, resolve_camera
from egosplat.gaussians.evaluation import Scores, describe, evaluate
from egosplat.gaussians.fitting import fit
from egosplat.gaussians.initialization import scene_extent
from egosplat.gaussians.io import put_curves, put_gaussians, read_trained_scene
from egosplat.gaussians.loss import L1Ssim, Objective
from egosplat.gaussians.render import TrainedScene
from egosplat.gaussians.schedule import TrainingOptions
from egosplat.gaussians.trainer import Curves, TrainingState, begin, resume_and_train
from egosplat.gaussians.training_views import Masking, Views, open_masking, read_views, split_views
from egosplat.language.targets import CodeTargets, JointLanguage
from egosplat.models.checkpoints import joint_hash
from egosplat.progress import log
from egosplat.rasterize.api import rasterizer_used, training_device
from egosplat.splats.cells import Cell, join_corrections, join_gaussians, read_cells
from egosplat.splats.imported import import_gaussians
from egosplat.splats.options import SplatsOptions

# Keys of a training that the stage has.
_TRAINING = {"max_points", "max_gaussians", "sh_degree", "evaluate_every"}


def run(
    frames_path: Path,
    poses_path: Path,
    output: Path,
    options: SplatsOptions,
    *,
    chunk: int | None = None,
    gather: Sequence[Path] = (),
    **more: Path | None,
) -> None:
    """Write the splats artifact of ``frames`` with ``poses``.

    A killed run resumes from its last checkpoint and gives identical Gaussians. UserError: no training frame has a pose, an
    input is missing or does not belong to the others, the backend cannot run, training diverges, the Gaussians of
    ``source`` cannot be read or do not fit, or the survey has no such cell.

    Args:
        chunk, gather: number of the survey's cell to train alone, from 1; artifacts of all cells, in order, to join.
        survey_path: excludes frames from training, unless nothing moves and nothing is masked; decides keys of the
            section ``camera`` that are ``auto``.
        transient_path: required if ``masking`` is ``initial``.
        masks_path: required if ``masking`` is ``refined``.
        instances_path, features_path: required if ``language`` is ``joint``.
    """
    frames, poses = open_artifact(frames_path, FRAMES), open_artifact(poses_path, POSES)
    if options.source is not None:
        if options.masking == "auto":  # later stages would refuse it
            open_masking("auto", frames, {})
        _import(output, frames, poses, options, source_files(options.source))
        return
    survey_path = more.get("survey_path")
    options = resolve_camera(options, survey_path)
    kept, by_survey = kept_frames(frames, survey_path, options.masking)
    masking = open_masking(options.masking, frames, more)
    language_inputs = []
    if options.language == "joint":
        needed = [(more.get(f"{schema.name}_path"), schema) for schema in (INSTANCES, FEATURES)]
        language_inputs = open_needed("splats.language = joint", *needed)
    check_made_from(poses, frames, axes=("frame",))
    used = [frames, poses, *language_inputs, *masking.artifacts]
    cells, of_cells = read_cells(survey_path, poses)
    if not (chunk or len(gather)) <= len(cells) or (gather and len(gather) < len(cells)):
        raise UserError(f"splats: the survey has {len(cells)} cells; give --chunk of one, or --gather of all")
    by_cell = {"cells": of_cells, "cell": chunk} if chunk or gather else {}
    record = provenance.begin_from("splats", options.as_dict() | by_survey | by_cell, used)
    training = TrainingOptions.of(options, options.recipe, **options.model_dump(include=_TRAINING))
    chosen = split_views(frames, poses, kept)
    cell = cells[chunk - 1] if chunk else None
    if cell is not None:
        chosen = chosen[0] & cell.frames, chosen[1] & cell.holds(poses.read("camera_to_world")[:, :3, 3])
    views, held_out = _view_sets(frames, poses, chosen, masking, training)
    if gather:
        _gather(output, record, gather, cells, (views, held_out), poses)
        return
    views = replace(views, near=cell and partial(cell.holds, wider=True))
    objective: Objective = L1Ssim(training.ssim_lambda)
    if language_inputs:
        targets = CodeTargets(*language_inputs, views.device)
        objective = JointLanguage(training.ssim_lambda, targets)
    state = begin(poses, views, training, objective, options)
    checkpoint = Checkpoint(output, provenance.key_of(record))
    resume_and_train(state, views, held_out, checkpoint, shown=True)
    _write(output, record, state, views, held_out, poses, masking)
    checkpoint.remove()


def _import(
    output: Path, frames: Artifact, poses: Artifact, options: SplatsOptions, files: list[Path]
) -> None:
    """Write the Gaussians of another program instead of training any."""
    check_made_from(poses, frames, axes=("frame",))
    record = provenance.begin_from(
        "splats", options.as_dict(), [frames, poses], {"source": joint_hash(files)}
    )
    training = TrainingOptions.of(options, options.recipe, **options.model_dump(include=_TRAINING))
    device = training_device(options.backend)
    gaussians, source = import_gaussians(files, frames, poses, training.render, device)
    masking = open_masking("none", frames, {})
    every = np.ones(frames.shape("rgb")[0], bool)
    # What the other program trained on is not known: evaluation frames are rendered, and may be among it.
    views, held_out = _view_sets(frames, poses, split_views(frames, poses, every), masking, training)
    scene = TrainedScene(gaussians, training.render, views.camera, gaussians.sh_degree)
    facts = {"iteration": 0, "skipped_rows": 0, "training_s": 0.0, "history_s": [], "source": source}
    extent = scene_extent(views.camera_to_world, options.near_plane)
    with create(output, SPLATS, record) as artifact:
        facts |= _facts(scene, views, held_out, extent)
        scores = _put(artifact, scene, Curves(), held_out, facts)
    log(f"{gaussians.count} Gaussians; evaluation frames{_summary(scores)}")


def _view_sets(
    frames: Artifact, poses: Artifact, chosen: Sequence[Bools], masking: Masking, options: TrainingOptions
) -> tuple[Views, Views]:
    """Read the training views and those held out."""
    device = training_device(options.render.backend)
    # Held-out frames are scored on all pixels that show the scene: masks must not make a score better.
    given, held_out = (read_views(frames, poses, rows, device) for rows in chosen)
    training = replace(given, transient=masking.frames(given.frame))
    _check_left(training, given, frames)
    counts = f"{len(training)} training, {len(held_out)} held out"
    log(f"frames: {counts}; rendered on {rasterizer_used(options.render.backend, device)}")
    return training, held_out


def _check_left(views: Views, given: Views, frames: Artifact) -> None:
    # Without this, training would run to its end with a loss of 0.
    if _has_weight(views):
        return
    if given.transient is not None and not _has_weight(given):
        raise UserError(
            f"{frames.path}: the pictures' own masks or transparency leave no pixel of any training frame; "
            "white shows the scene in a mask_path of transforms.json, and black in dynamic_mask_*.png"
        )
    raise UserError(
        "splats.masking leaves no pixel of any training frame; raise masks.threshold, or set splats.masking to none"
    )


def _has_weight(views: Views) -> bool:
    weights = (views.weight(index) for index in range(len(views)))
    return any(weight is None or bool(weight.any()) for weight in weights)


def _write(
    output: Path,
    record: Provenance,
    state: TrainingState,
    views: Views,
    held_out: Views,
    poses: Artifact,
    masking: Masking,
) -> None:
    """Evaluate and write the Gaussians."""
    scene, corrections = state.scene(views.camera), state.corrections
    facts = _facts(scene, views, held_out, state.extent) | {
        "iteration": state.iteration,
        "skipped_rows": state.optimizer.skipped_rows,
        "training_s": round(state.seconds, 3),
        "history_s": state.curves.seconds,
    }
    with create(output, SPLATS, record) as artifact:
        if corrections is not None:
            given = _put_held_out(artifact, scene, held_out, "_given")
            log(f"held out{_summary(given)}")
            # What moves is not in the Gaussians: it must not pull at the pose. The scores count it.
            unmasked = replace(held_out, transient=masking.frames(held_out.frame))
            guess = corrections.values_at(held_out.frame)
            fitted = fit(scene, unmasked, guess, corrections)
            _put_corrections(artifact, corrections, poses, held_out, fitted)
            held_out = applied(held_out, fitted, corrections.compression)
            facts |= {"scene_depth": corrections.depth, "up": poses.read("up").tolist()}
            facts["highlight_compression"] = float(corrections.compression)
        scores = _put(artifact, scene, state.curves, held_out, facts)
    told = _summary(scores, fitted=corrections is not None)
    log(f"{scene.gaussians.count} Gaussians after {state.iteration} iterations; held out{told}")


def _gather(
    output: Path,
    record: Provenance,
    paths: Sequence[Path],
    cells: Sequence[Cell],
    sets: tuple[Views, Views],
    poses: Artifact,
) -> None:
    """Make one scene of the artifacts of all cells, and evaluate and write it."""
    parts, (views, held_out) = [open_artifact(path, SPLATS) for path in paths], sets
    for number, part in enumerate(parts, 1):
        made, wanted = part.provenance, replace(record, options={**record.options, "cell": number})
        if any(made[name] != getattr(wanted, name) for name in ("options", "inputs", "code", "versions")):
            again = "by other options, inputs or code; remove it, and run the same again"
            raise UserError(f"{part.path}: is not cell {number}, or {again}")
    corrected, offsets = {}, np.zeros((len(cells), 6))
    if parts[0].has("corrections/gain"):
        corrected, offsets = join_corrections(parts, cells, poses.read("camera_to_world")[:, :3, 3])
    gaussians = join_gaussians(parts, cells, offsets).to(views.device)
    scene = replace(read_trained_scene(parts[0], record.options["backend"]), gaussians=gaussians)
    facts = _facts(scene, views, held_out, scene_extent(views.camera_to_world, scene.settings.near_plane))
    facts = dict(parts[0].facts) | facts | {"history_s": []}
    facts |= {name: sum(part.facts[name] for part in parts) for name in ("skipped_rows", "training_s")}
    costs = [{name: part.provenance[name] for name in record.cost()} for part in parts]
    with create(output, SPLATS, replace(record, gathered=costs)) as artifact:
        if corrected:
            _put_held_out(artifact, scene, held_out, "_given")
            for name, values in corrected.items():
                artifact.put(f"corrections/{name}", values)
            compression = np.mean([part.facts["highlight_compression"] for part in parts])
            facts["highlight_compression"] = float(compression)
            facts["scene_depth"] = float(np.median([part.facts["scene_depth"] for part in parts]))
            pose, gain = (corrected[name][held_out.frame] for name in ("camera_to_world", "gain"))
            tone = {"log_gain": torch.from_numpy(np.log(gain)), "compression": torch.tensor([compression])}
            held_out = replace(held_out, camera_to_world=pose, **tone)
        scores = _put(artifact, scene, Curves(), held_out, facts)
    told = _summary(scores, fitted=bool(corrected))
    log(f"{gaussians.count} Gaussians of {len(cells)} cells; held out{told}")


def _put_corrections(
    artifact: Writer, corrections: Corrections, poses: Artifact, held_out: Views, fitted: torch.Tensor
) -> None:
    """Store the corrections of all frames: trained, (V, 9) ``fitted`` of the views held out, and those in between."""
    registered, camera_to_world = np.flatnonzero(poses.read("registered")), poses.read("camera_to_world")
    values = torch.zeros(len(camera_to_world), fitted.shape[1], dtype=torch.float64)
    values[registered] = corrections.values_at(registered)
    values[held_out.frame] = fitted
    source = np.full(len(values), AS_GIVEN, np.int8)
    source[registered] = INTERPOLATED if corrections.smooth else AS_GIVEN
    source[corrections.trained_frames] = TRAINED
    source[held_out.frame] = FITTED
    shift, turn = values[:, :3].numpy(), np.degrees(values[:, 3:6].norm(dim=1).numpy())
    artifact.put("corrections/camera_to_world", corrected_poses(camera_to_world, values))
    artifact.put("corrections/source", source)
    artifact.put("corrections/shift", shift)
    artifact.put("corrections/turn", turn)
    artifact.put("corrections/gain", values[:, LOG_GAIN].exp().numpy())
    moved = f"{np.linalg.norm(shift, axis=1).max():.2g} {length_unit(poses)}"
    log(f"poses corrected by up to {moved} and {turn.max():.2f} degrees")


def _put(
    artifact: Writer, scene: TrainedScene, curves: Curves, held_out: Views, facts: dict[str, Any]
) -> Scores:
    """Store Gaussians, curves and facts, and the held-out frames with their scores."""
    scores = _put_held_out(artifact, scene, held_out)
    put_gaussians(artifact, scene.gaussians)
    put_curves(artifact, curves)
    artifact.put("held_out/frame", held_out.frame)
    artifact.facts = facts
    return scores


def _put_held_out(artifact: Writer, scene: TrainedScene, held_out: Views, suffix: str = "") -> Scores:
    """Render the held-out frames and store the renders and their scores; ``suffix`` ends the names of the arrays."""
    camera, render = held_out.camera, f"held_out/render{suffix}"
    artifact.allocate(render, (len(held_out), camera.height, camera.width, 3))
    scores = evaluate(scene, held_out, partial(artifact.put_row, render))
    for name, values in zip(("psnr", "ssim"), scores, strict=True):
        artifact.put(f"held_out/{name}{suffix}", np.ascontiguousarray(values))
    return scores


def _summary(scores: Scores, *, fitted: bool = False) -> str:
    if not len(scores[0]):
        return ": no frame"
    poses = "with fitted corrections" if fitted else "as given"
    return f" {poses}: {describe(*scores)}"


def _facts(scene: TrainedScene, views: Views, held_out: Views, extent: float) -> dict[str, Any]:
    return {
        "camera": asdict(scene.camera),
        "rasterizer": rasterizer_used(scene.settings.backend, views.device),
        "extent_m": extent,
        "views": {"training": len(views), "held out": len(held_out)},
        "sh_degree_in_use": scene.sh_degree,
    }

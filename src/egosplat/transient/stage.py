"""Stage ``transient``: train the network H with temporary 3D Gaussians, and predict all frames."""

from pathlib import Path
from typing import Any

import numpy as np
import torch

from egosplat.artifacts import provenance
from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.consistency import check_made_from, kept_frames
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FRAMES, POSES, TRANSIENT, lies_on_its_side
from egosplat.artifacts.writer import Writer, create
from egosplat.files import expand_home
from egosplat.gaussians.corrections import resolve_camera
from egosplat.gaussians.schedule import TrainingOptions
from egosplat.gaussians.trainer import begin, train_alone
from egosplat.gaussians.training_views import Views, read_views, split_views
from egosplat.images import resize_labels, shrink_image
from egosplat.models.checkpoints import content_hash
from egosplat.progress import log, track
from egosplat.rasterize.api import rasterizer_used, training_device
from egosplat.transient.network import TransientNet, make_network
from egosplat.transient.objective import InitialObjective
from egosplat.transient.options import TEMPORARY, TransientOptions


def run(
    frames_path: Path,
    poses_path: Path,
    output: Path,
    options: TransientOptions,
    *,
    survey_path: Path | None = None,
) -> None:
    """Write the transient artifact of ``frames`` with ``poses``. A killed run resumes and gives an identical result. The survey excludes
    frames from training, and decides keys that are ``auto``. UserError: no training frame has a pose, the inputs do not belong together,
    the weights cannot be read, the backend cannot run, or training diverges."""
    frames, poses = open_artifact(frames_path, FRAMES), open_artifact(poses_path, POSES)
    check_made_from(poses, frames, axes=("frame",))
    if told := options.stays_at_start():
        log(f"warning: {told}")
    options = resolve_camera(options, survey_path)
    kept, by_survey = kept_frames(frames, survey_path)
    weights = None if options.encoder_weights is None else expand_home(options.encoder_weights)
    net = make_network(options.input_size, lies_on_its_side(frames), weights, options.seed)
    models = {} if weights is None else {"encoder_weights": content_hash(weights)[:16]}
    record = provenance.begin_from("transient", options.as_dict() | by_survey, (frames, poses), models)
    training, _ = split_views(frames, poses, kept)
    device = training_device(options.backend)
    views = read_views(frames, poses, training, device, resolution=options.resolution)
    log(f"{len(views)} training views of {views.camera.width} x {views.camera.height} pixels")
    objective = InitialObjective(net, options, views.device)
    # Temporary Gaussians need no intermediate evaluations.
    keys = {"evaluate_every": options.iterations} | TEMPORARY[options.recipe]
    gaussian_options = TrainingOptions.of(options, options.recipe, **keys)
    state = begin(poses, views, gaussian_options, objective, options)
    checkpoint = Checkpoint(output, provenance.key_of(record))
    train_alone(state, views, checkpoint)
    with create(output, TRANSIENT, record) as artifact:
        artifact.put("curve/iteration", np.array(state.curves.iteration, np.int64))
        artifact.put("curve/loss", np.array(state.curves.loss, np.float64))
        artifact.put("curve/probability", objective.mean_probability(state.curves.iteration))
        tensors = _put_weights(artifact, net)
        mean = _put_probability(artifact, frames, net, options, views.device)
        scale = _put_residuals(artifact, frames, views, objective, options.transient_penalty)
        artifact.facts = {
            "rasterizer": rasterizer_used(options.backend, views.device),
            "working_size": [views.camera.height, views.camera.width],
            "views": len(views),
            "gaussians": state.gaussians.count,
            "training_s": round(state.seconds, 3),
            "mean_probability": mean,
            "residual_scale": scale,
            "tensors": tensors,
        }
    checkpoint.remove()


def _put_weights(artifact: Writer, net: TransientNet) -> list[list[Any]]:
    """Store the network with its running statistics; returns name and shape of each tensor, in order."""
    tensors = {name: tensor for name, tensor in net.state_dict().items() if tensor.is_floating_point()}
    flat = torch.cat([tensor.detach().cpu().flatten() for tensor in tensors.values()])
    artifact.put("weights", flat.numpy())
    return [[name, list(tensor.shape)] for name, tensor in tensors.items()]


def _put_residuals(
    artifact: Writer, frames: Artifact, views: Views, objective: InitialObjective, penalty: float
) -> float | None:
    """Store the residuals of the views, enlarged to the frames; returns their median, None if nothing was measured."""
    count, height, width, _ = frames.shape("rgb")
    residuals = objective.residuals
    size = (views.camera.height, views.camera.width)
    inside = np.ones(size, bool) if views.valid is None else (views.valid > 0).cpu().numpy()
    scale = np.full(count, np.nan, np.float32)
    scale[views.frame[: len(residuals.scale)]] = residuals.scale.cpu().numpy()
    artifact.put("residual_scale", scale)
    artifact.put("compared", resize_labels(inside, width, height))
    artifact.allocate("stands_out", (count, height, width))
    shown = {frame: view for view, frame in enumerate(views.frame[: len(residuals.scale)].tolist())}
    for frame in range(count):
        row = residuals.stands_out(shown[frame]) if frame in shown else np.zeros_like(inside)
        artifact.put_row("stands_out", frame, resize_labels(row, width, height))
    if np.isnan(scale).all():
        return None
    median = float(np.nanmedian(scale))
    log(
        f"median residual after the warm-up: {median:.2g}; penalty of a transient pixel: {penalty * median:.2g}"
    )
    return median


@torch.no_grad()
def _put_probability(
    artifact: Writer, frames: Artifact, net: TransientNet, options: TransientOptions, device: torch.device
) -> float:
    """Predict every frame and store the probabilities; returns the mean over frames of what their own masks leave."""
    # In mode train, prediction changes the running statistics; they are stored already.
    net.train(options.recipe == "own")
    count, height, width, _ = frames.shape("rgb")
    artifact.allocate("probability", (count, height, width))
    total = 0.0
    for frame in track(range(count), "predicting"):
        picture = shrink_image(frames.row("rgb", frame), options.resolution)
        # Predicted at the working size and enlarged to the frame: the network was trained at that size.
        probability = net(torch.from_numpy(picture).to(device).float() / 255.0, height, width).cpu()
        shown = probability
        if frames.has("masked"):
            shown = probability[torch.from_numpy(~frames.row("masked", frame))]
        total += float(shown.mean()) if shown.numel() else 0.0
        artifact.put_row("probability", frame, probability.numpy().astype(np.float16))
    mean = total / max(count, 1)
    log(f"pixels that move, by the network: {mean:.1%}")
    return mean

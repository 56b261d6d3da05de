"""Stage ``transient``: the network H, trained together with temporary 3D Gaussians, and what it says of all frames."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from egosplat.artifacts import provenance
from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.consistency import check_made_from
from egosplat.artifacts.frames import FRAMES
from egosplat.artifacts.kept_frames import kept_frames
from egosplat.artifacts.poses import POSES
from egosplat.artifacts.provenance import Provenance
from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.transient import TRANSIENT
from egosplat.artifacts.writer import Writer, create
from egosplat.compute import single_thread
from egosplat.gaussians.device import rasterizer_used, training_device
from egosplat.gaussians.initialization import scene_extent
from egosplat.gaussians.options import TrainingOptions
from egosplat.gaussians.render import RenderSettings
from egosplat.gaussians.starting_points import starting_gaussians
from egosplat.gaussians.trainer import Photographs, resume_and_train
from egosplat.gaussians.training_state import TrainingState
from egosplat.gaussians.training_views import Mask, split_views
from egosplat.models.checkpoints import content_hash
from egosplat.progress import log, track
from egosplat.transient.network import TransientNet, make_network
from egosplat.transient.objective import InitialObjective, InitialOptions
from egosplat.transient.pictures import read_reduced_views, reduced, working_size

POSITION_LR = 1.6e-4
"""The temporary Gaussians' learning rate of the means: stock 3DGS's."""


@dataclass(frozen=True)
class TransientOptions:
    """The schema's keys of ``transient``; ``config.schema.yaml`` describes each."""

    iterations: int
    warmup: float
    resolution: int
    transient_penalty: float
    residual: str
    lr: float
    input_size: int
    encoder_weights: str | None
    batch_norm: str
    strategy: str
    schedule: str
    max_points: int
    densify_init: bool
    max_gaussians: int
    grow_grad2d: float
    reset_opacity: float
    reset_at_start: bool
    prune_screen_px: float | None
    sh_degree: int
    near_plane: float
    background: str
    checkpoint_s: float
    backend: str
    seed: int

    @property
    def gaussians(self) -> TrainingOptions:
        """How the temporary Gaussians are trained."""
        return TrainingOptions(
            render=RenderSettings(
                near_plane=self.near_plane,
                background=self.background,
                antialiased=False,
                backend=self.backend,
            ),
            iterations=self.iterations,
            strategy=self.strategy,
            max_gaussians=self.max_gaussians,
            position_lr=POSITION_LR,
            grow_grad2d=self.grow_grad2d,
            reset_opacity=self.reset_opacity,
            reset_at_start=self.reset_at_start,
            prune_screen_px=self.prune_screen_px,
            cuts_schedule=self.schedule == "cut",
            evaluate_every=self.iterations,
            patience=0,
            min_improvement=0.0,
            seed=self.seed,
        )

    @property
    def network(self) -> InitialOptions:
        """How the network is trained."""
        return InitialOptions(
            iterations=self.iterations,
            warmup=round(self.warmup * self.iterations),
            transient_penalty=self.transient_penalty,
            residual=self.residual,
            lr=self.lr,
        )


def run(
    frames: Path, poses: Path, output: Path, options: TransientOptions, *, survey: Path | None = None
) -> None:
    """Write the transient artifact of ``frames`` with ``poses``.

    A run that was killed goes on from its last checkpoint, to the same result as without the kill. On a CPU it trains
    on one thread, without which it would not repeat.

    Args:
        frames, poses, output: paths.
        survey: the frames that it leaves out are not trained on.

    Raises:
        UserError: no training frame has a pose, the inputs do not belong together, the weights cannot be read,
            the backend cannot run, training diverges.
    """
    pictures, walk = open_artifact(frames, FRAMES), open_artifact(poses, POSES)
    check_made_from(walk, pictures, axes=("frame",))
    kept, by_survey = kept_frames(pictures, survey)
    weights = None if options.encoder_weights is None else Path(options.encoder_weights).expanduser()
    net = make_network(options.input_size, _sideways(pictures), weights, options.seed)
    made = _begin(asdict(options) | by_survey, pictures, walk, weights)
    photographs = _photographs(pictures, walk, kept, options.resolution, training_device(options.backend))
    views = photographs.training
    start = starting_gaussians(
        walk,
        views,
        max_points=min(options.max_points, options.max_gaussians),
        densify_init=options.densify_init,
        sh_degree=options.sh_degree,
        near_plane=options.near_plane,
        seed=options.seed,
    )
    objective = InitialObjective(net, options.network, views.device)
    state = TrainingState(start, options.gaussians, scene_extent(views.camera_to_world), objective)
    checkpoint = Checkpoint(output, provenance.key_of(made), options.checkpoint_s)
    with single_thread():
        resume_and_train(state, photographs, options.gaussians, checkpoint)
    with create(output, TRANSIENT, made) as artifact:
        _put_curves(artifact, state, objective)
        tensors = _put_weights(artifact, net)
        mean = _put_probability(artifact, pictures, net, options, views.device)
        artifact.facts = {
            "rasterizer": rasterizer_used(options.backend, views.device),
            "working_size": [views.camera.height, views.camera.width],
            "views": len(views),
            "gaussians": state.gaussians.count,
            "training_s": round(state.seconds, 3),
            "mean_probability": mean,
            "tensors": tensors,
        }
    checkpoint.remove()


def _sideways(pictures: Artifact) -> bool:
    """Whether the pictures are as Aria's sensor takes them."""
    return pictures.facts.get("format") == "adt" and not pictures.facts["upright"]


def _begin(keys: dict[str, Any], pictures: Artifact, walk: Artifact, weights: Path | None) -> Provenance:
    models = {} if weights is None else {"encoder_weights": content_hash(weights)[:16]}
    return provenance.begin_from("transient", keys, (pictures, walk), models)


def _photographs(
    pictures: Artifact, walk: Artifact, kept: Mask, resolution: int, device: torch.device
) -> Photographs:
    """The training views alone: nothing is decided or measured by others here."""
    flags = pictures.read("train") & kept, pictures.read("evaluation"), walk.read("registered")
    training = split_views(*flags, validate=False).training
    views, none = (
        read_reduced_views(pictures, walk, chosen, resolution, device)
        for chosen in (training, np.zeros_like(training))
    )
    camera = views.camera
    log(f"{len(views)} training views of {camera.width} x {camera.height} pixels")
    return Photographs(views, validation=none, held_out=none, aside=none)


def _put_curves(artifact: Writer, state: TrainingState, objective: InitialObjective) -> None:
    curves = state.curves
    artifact.put("curve/iteration", np.array(curves.iteration, np.int64))
    artifact.put("curve/loss", np.array(curves.loss, np.float64))
    artifact.put("curve/probability", objective.mean_probability(curves.iteration))


def _put_weights(artifact: Writer, net: TransientNet) -> list[list[Any]]:
    """Store the network, its running statistics too; the result is name and shape of each tensor, in order."""
    tensors = {name: tensor for name, tensor in net.state_dict().items() if tensor.is_floating_point()}
    flat = torch.cat([tensor.detach().cpu().flatten() for tensor in tensors.values()])
    artifact.put("weights", flat.numpy())
    return [[name, list(tensor.shape)] for name, tensor in tensors.items()]


@torch.no_grad()
def _put_probability(
    artifact: Writer,
    pictures: Artifact,
    net: TransientNet,
    options: TransientOptions,
    device: torch.device,
) -> float:
    """Store what the network says of each frame; its running statistics have been stored and may change.

    Returns:
        The mean over all pixels of all frames.
    """
    net.train(options.batch_norm == "train")
    count, height, width, _ = pictures.shape("rgb")
    size = working_size(height, width, options.resolution)
    artifact.allocate("probability", (count, height, width))
    total = 0.0
    for frame in track(range(count), "predicting"):
        picture = torch.from_numpy(reduced(pictures.row("rgb", frame), *size)).to(device).float() / 255.0
        probability = net(picture, height, width).cpu()
        total += float(probability.mean())
        artifact.put_row("probability", frame, probability.numpy().astype(np.float16))
    mean = total / max(count, 1)
    log(f"mean probability of being transient: {mean:.4f}")
    return mean

"""The training loop of 3DGS (Kerbl et al. 2023), one photograph per iteration, and its complete state for checkpoints."""

import contextlib
import math
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
from PIL import Image
from torch import Tensor

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.artifacts.reader import Artifact
from egosplat.compute import single_thread
from egosplat.errors import UserError
from egosplat.files import atomic_file
from egosplat.gaussians.corrections import Corrections, applied, make_corrections
from egosplat.gaussians.density_control import DensityControl
from egosplat.gaussians.evaluation import describe, develop, evaluate, mean_known
from egosplat.gaussians.initialization import scene_extent, starting_gaussians
from egosplat.gaussians.loss import Objective
from egosplat.gaussians.model import PARAMETERS, Gaussians
from egosplat.gaussians.optimizer import Adam, LearningRates
from egosplat.gaussians.render import TrainedScene, render
from egosplat.gaussians.schedule import Schedule, TrainingOptions
from egosplat.gaussians.training_views import Views
from egosplat.geometry import Camera
from egosplat.pipeline.shared_options import CameraOptions
from egosplat.progress import log, track


@dataclass
class Curves:
    """Training curves.

    Attributes:
        iteration, loss, gaussians: of each record: last iteration, mean loss, number of Gaussians.
        evaluated, psnr, ssim: of each evaluation: iteration, means over the held-out views; NaN if there are none.
        seconds: training time at each evaluation; the only numbers that differ between identical runs.
    """

    iteration: list[int] = field(default_factory=list)
    loss: list[float] = field(default_factory=list)
    gaussians: list[int] = field(default_factory=list)
    evaluated: list[int] = field(default_factory=list)
    psnr: list[float] = field(default_factory=list)
    ssim: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)


class TrainingState:
    """The state of a training run after an iteration.

    Attributes:
        gaussians: leaves, attached to ``optimizer``.
        options: of the training.
        corrections: of the training views; None if neither poses nor exposure are corrected.
        order: remaining views of this epoch, the next one last.
        seconds: training time so far.
        loss_sum: sum over the iterations since the last record, on the Gaussians' device.
        bad_records: consecutive records with a loss that is not finite.
    """

    def __init__(
        self,
        start: Gaussians,
        options: TrainingOptions,
        extent: float,
        objective: Objective,
        corrections: Corrections | None = None,
    ) -> None:
        """Create the state before the first iteration; ``start`` is not copied, ``extent`` is that of the scene [m]."""
        self.gaussians, self.options = start.requires_grad_(), options
        # 3DGS scales only the learning rate of the means, because only means have the unit of the scene.
        self.optimizer = Adam(start, LearningRates(means=options.schedule.position_lr_init * extent))
        self.density = DensityControl(options, extent)
        self.objective = objective
        self.corrections = corrections
        # On the CPU: a GPU's generator would draw other numbers from the same seed.
        self.generator = torch.Generator().manual_seed(options.seed)
        self.order: list[int] = []
        self.curves = Curves()
        self.iteration = 0
        self.seconds = 0.0
        self.loss_sum = start.means.new_zeros(())
        self.bad_records = 0
        self.extent = extent

    def scene(self, camera: Camera) -> TrainedScene:
        """The scene as it is trained so far."""
        sh_degree = self.options.schedule.sh_degree(self.iteration, self.gaussians.sh_degree)
        return TrainedScene(self.gaussians, self.options.render, camera, sh_degree)

    def next_view(self, views: int) -> int:
        """Return the next view of this epoch's random permutation of so many ``views``."""
        if not self.order:
            self.order = torch.randperm(views, generator=self.generator).tolist()
        return self.order.pop()

    def state_dict(self) -> dict[str, Any]:
        """Return tensors and numbers, nested in lists and dictionaries, for ``load_state_dict``."""
        return {
            "gaussians": self.gaussians.detach().parameters(),
            "optimizer": self.optimizer.state_dict(),
            "density": self.density.state_dict(),
            "objective": self.objective.state_dict(),
            "corrections": self.corrections and self.corrections.state_dict(),
            "generator": self.generator.get_state(),
            "order": list(self.order),
            "curves": asdict(self.curves),
            "loss_sum": self.loss_sum,
            **{name: getattr(self, name) for name in _NUMBERS},
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state from ``state_dict``, on the device of the current Gaussians."""
        device = self.gaussians.means.device
        state = _moved(state, device)
        self.gaussians = Gaussians(**{name: state["gaussians"][name] for name in PARAMETERS}).requires_grad_()
        self.optimizer = Adam(self.gaussians, self.optimizer.learning_rates)
        self.optimizer.load_state_dict(state["optimizer"])
        self.density.load_state_dict(state["density"])
        self.objective.load_state_dict(state["objective"])
        if self.corrections is not None:
            self.corrections.load_state_dict(state["corrections"])
        self.generator.set_state(state["generator"].cpu())
        self.order = state["order"]
        self.curves = Curves(**state["curves"])
        self.loss_sum = state["loss_sum"]
        for name in _NUMBERS:
            setattr(self, name, state[name])


def begin(
    poses: Artifact, views: Views, options: TrainingOptions, objective: Objective, camera: CameraOptions
) -> TrainingState:
    """The state before the first iteration on ``views``; ``camera`` are options after ``resolve_camera``. Raises as ``starting_gaussians``."""
    near_plane, start = options.render.near_plane, starting_gaussians(poses, views, options)
    start = replace(start, features=start.means.new_zeros(start.count, objective.features))
    extent = scene_extent(views.camera_to_world, near_plane)
    corrections = make_corrections(camera, start, views, near_plane, options.iterations)
    return TrainingState(start, options, extent, objective, corrections)


_NUMBERS = ("iteration", "seconds", "bad_records")


def _moved(value: Any, device: torch.device) -> Any:
    """Move all tensors in nested lists and dictionaries to ``device``."""
    if isinstance(value, dict):
        return {key: _moved(item, device) for key, item in value.items()}
    if isinstance(value, list):
        return [_moved(item, device) for item in value]
    return value.to(device) if isinstance(value, Tensor) else value


# Iterations per record. Checkpoints are written at records only. On a GPU, reading the loss more often
# would stall it.
RECORD_EVERY = 10

# Consecutive records without a finite loss that end training.
_BAD_RECORDS = 3


def resume_and_train(
    state: TrainingState, views: Views, held_out: Views, checkpoint: Checkpoint, *, shown: bool = False
) -> None:
    """Train from the checkpoint, if there is one, until the last iteration; changes ``state``. ``shown``: the checkpoint's picture
    is drawn. UserError: training diverges, or no Gaussian is left. It removes the checkpoint: resuming would fail again."""
    if (saved := checkpoint.load()) is not None:
        state.load_state_dict(saved)
        log(f"training resumes after iteration {state.iteration}")
    options, schedule = state.options, state.options.schedule
    started = time.perf_counter() - state.seconds
    rest = range(state.iteration + 1, options.iterations + 1)
    try:
        for iteration in track(rest, "training", unit="iteration"):
            iterate(state, views, schedule)
            last = iteration == options.iterations
            recorded = iteration % RECORD_EVERY == 0 or last
            if recorded:
                record(state)
            state.seconds = time.perf_counter() - started
            # Just after a reset, Gaussians are nearly transparent: scores would say nothing.
            evaluated = iteration % options.evaluate_every == 0 and not schedule.resets_opacity(iteration)
            if evaluated or last:
                measure(state, held_out)
            if shown and (last or iteration % max(options.evaluate_every // 2, 1) == 0):
                draw(state, views, checkpoint.picture)
            if recorded:
                checkpoint.save_if_due(state.state_dict)
    except UserError:
        checkpoint.remove()
        raise


def train_alone(state: TrainingState, views: Views, checkpoint: Checkpoint) -> None:
    """Train Gaussians that are not kept as ``resume_and_train`` does, with no view held out."""
    none = replace(views, frame=views.frame[:0], camera_to_world=views.camera_to_world[:0])
    # Sums over several threads on a CPU would differ from run to run.
    with single_thread():
        resume_and_train(state, views, none, checkpoint)


def draw(state: TrainingState, views: Views, output: Path) -> None:
    """Write a picture of the middle training view, and beside it what the Gaussians show of it so far, if the disk has room."""
    middle = len(views) // 2
    shown = develop(state.scene(views.camera), views.camera, views.camera_to_world[middle], None, None)
    pair = torch.cat([views.pictures[middle], shown.cpu()], dim=1)
    with contextlib.suppress(OSError), atomic_file(output) as scratch:
        Image.fromarray(pair.numpy()).save(scratch, format="PNG")


def iterate(state: TrainingState, views: Views, schedule: Schedule) -> None:
    """Run one iteration with one of the views; changes ``state`` and adds the loss to ``state.loss_sum``."""
    iteration, corrections, settings = state.iteration + 1, state.corrections, state.options.render
    index = state.next_view(len(views))
    state.optimizer.means_lr = schedule.position_lr(iteration, state.extent)
    state.optimizer.zero_grad()
    image, _, meta = render(
        state.gaussians,
        views.camera,
        views.camera_to_world[index] if corrections is None else corrections.camera_to_world(index),
        settings,
        sh_degree=schedule.sh_degree(iteration, state.gaussians.sh_degree),
        background=settings.color_behind,
    )
    if corrections is not None:
        image = corrections.exposed(image, views.picture(index))
    loss = state.objective.loss(image, views, index)
    # Density control uses the statistics of this iteration later.
    observed = iteration < schedule.densify_until
    if observed:
        # Density control needs this gradient; autograd keeps only those of leaves.
        meta["means2d"].retain_grad()
    loss.backward()
    state.objective.step()
    if corrections is not None:
        corrections.step(index, iteration)
    radii = meta["radii"]
    if observed:
        state.density.observe(meta["means2d"].grad, radii, views.camera.width, views.camera.height)
    # The loss reaches visible Gaussians only; both radii of the others are 0.
    state.optimizer.step((radii[..., 0] > 0).any(dim=0))
    # After the optimizer's step, as in EgoLifter and gsplat. The first 3DGS code runs density control before the step,
    # so that new Gaussians skip it.
    state.gaussians = state.density.step(iteration, state.gaussians, state.optimizer, state.generator)
    state.loss_sum += loss.detach()
    state.iteration = iteration


def record(state: TrainingState) -> None:
    """Append the mean loss since the last record to the curves; UserError if it was not finite several times in a row."""
    curves = state.curves
    before = curves.iteration[-1] if curves.iteration else 0
    # Reading the sum waits for the GPU, which is why it is read only at records.
    loss = float(state.loss_sum) / (state.iteration - before)
    state.loss_sum.zero_()
    curves.iteration.append(state.iteration)
    curves.loss.append(loss)
    curves.gaussians.append(state.gaussians.count)
    state.bad_records = 0 if math.isfinite(loss) else state.bad_records + 1
    if state.bad_records >= _BAD_RECORDS:
        raise UserError(
            f"training diverged at iteration {state.iteration} (the loss is {loss}); {state.objective.advice}"
        )


def measure(state: TrainingState, held_out: Views) -> None:
    """Evaluate, append the scores to the curves and log them."""
    poses = "as given"
    if (corrections := state.corrections) is not None:
        # A fit would take longer than the evaluation, and scores of other poses are other scores.
        held_out = applied(held_out, corrections.values_at(held_out.frame), corrections.compression)
        poses = "corrected as the frames before and after"
    psnr, ssim = evaluate(state.scene(held_out.camera), held_out)
    curves = state.curves
    curves.evaluated.append(state.iteration)
    curves.psnr.append(mean_known(psnr))
    curves.ssim.append(mean_known(ssim))
    curves.seconds.append(round(state.seconds, 3))
    told = [f"iteration {state.iteration}: {state.gaussians.count} Gaussians"]
    told += [f"loss {curves.loss[-1]:.4f}"] if curves.loss else []
    if not math.isnan(curves.psnr[-1]):
        told += [f"held-out frames {poses}: {describe(psnr, ssim)}"]
    log(", ".join(told))

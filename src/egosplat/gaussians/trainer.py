"""The training loop of 3DGS (Kerbl et al. 2023): one photograph per iteration."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.errors import UserError
from egosplat.gaussians.corrections import applied
from egosplat.gaussians.evaluation import evaluate
from egosplat.gaussians.options import TrainingOptions
from egosplat.gaussians.render import render
from egosplat.gaussians.schedule import Schedule
from egosplat.gaussians.training_state import TrainingState
from egosplat.gaussians.training_views import Views
from egosplat.progress import log, track

# Iterations per record. Checkpoints are written at records only. On a GPU, reading the loss more often
# would stall it.
RECORD_EVERY = 10

# Consecutive records without a finite loss that end training.
_BAD_RECORDS = 3


@dataclass(frozen=True)
class ViewSets:
    """The views by role; see ``egosplat.gaussians.training_views.Split``."""

    training: Views
    held_out: Views


def resume_and_train(
    state: TrainingState, view_sets: ViewSets, options: TrainingOptions, checkpoint: Checkpoint
) -> None:
    """Run ``train`` from the checkpoint if there is one. A UserError removes the checkpoint.

    Raises:
        UserError: as ``train``.
    """
    if (saved := checkpoint.load()) is not None:
        state.load_state_dict(saved)
        log(f"training resumes after iteration {state.iteration}")
    try:
        train(state, view_sets, options, checkpoint)
    except UserError:
        checkpoint.remove()  # resuming would fail again
        raise


def train(
    state: TrainingState, view_sets: ViewSets, options: TrainingOptions, checkpoint: Checkpoint
) -> None:
    """Train until the last iteration; changes ``state``.

    Raises:
        UserError: training diverges, or no Gaussian is left.
    """
    schedule = options.schedule
    started = time.perf_counter() - state.seconds
    rest = range(state.iteration + 1, options.iterations + 1)
    for iteration in track(rest, "training", unit="iteration"):
        iterate(state, view_sets.training, options, schedule)
        last = iteration == options.iterations
        recorded = iteration % RECORD_EVERY == 0 or last
        if recorded:
            record(state)
        state.seconds = time.perf_counter() - started
        # Just after a reset, Gaussians are nearly transparent: scores would say nothing.
        evaluated = iteration % options.evaluate_every == 0 and not schedule.resets_opacity(iteration)
        if evaluated or last:
            measure(state, view_sets, options, schedule)
        if recorded:
            checkpoint.save_if_due(state.state_dict)


def iterate(
    state: TrainingState,
    views: Views,
    options: TrainingOptions,
    schedule: Schedule,
) -> None:
    """Run one iteration with one of the views; changes ``state`` and adds the loss to ``state.loss_sum``."""
    iteration, corrections = state.iteration + 1, state.corrections
    index = state.next_view(len(views))
    state.optimizer.means_lr = schedule.position_lr(iteration, state.extent)
    state.optimizer.zero_grad()
    image, _, meta = render(
        state.gaussians,
        views.camera,
        views.camera_to_world[index] if corrections is None else corrections.camera_to_world(index),
        options.render,
        sh_degree=schedule.sh_degree(iteration, state.gaussians.sh_degree),
        background=draw_background(options.render.background, state.generator),
    )
    if corrections is not None:
        image = corrections.exposed(image, views.picture(index))
    loss = state.objective.loss(image, views, index)
    observed = schedule.observes(iteration)
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
    # The loss reaches visible Gaussians only. ``all`` takes twice the time of ``amin``.
    state.optimizer.step((radii.amin(dim=-1) > 0).any(dim=0))
    # After the optimizer's step, as in EgoLifter and gsplat. The first 3DGS code runs density control before the step,
    # so that new Gaussians skip it.
    state.gaussians = state.density.step(iteration, state.gaussians, state.optimizer, state.generator)
    state.loss_sum += loss.detach()
    state.iteration = iteration


def draw_background(kind: str, generator: torch.Generator) -> Tensor | None:
    """Return the (3,) float32 background color of a training iteration; None for black."""
    if kind == "random":
        return torch.rand(3, generator=generator)
    return torch.ones(3) if kind == "white" else None


def record(state: TrainingState) -> None:
    """Append the mean loss since the last record to the curves.

    Raises:
        UserError: the loss was not finite in several consecutive records.
    """
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


def measure(state: TrainingState, view_sets: ViewSets, options: TrainingOptions, schedule: Schedule) -> None:
    """Evaluate, append the scores to the curves and log them."""
    sh_degree = schedule.sh_degree(state.iteration, state.gaussians.sh_degree)
    held_out = evaluate(state.gaussians, _corrected(state, view_sets.held_out), options.render, sh_degree)
    curves = state.curves
    curves.evaluated.append(state.iteration)
    curves.psnr.append(held_out.mean_psnr)
    curves.ssim.append(held_out.mean_ssim)
    curves.seconds.append(round(state.seconds, 3))
    log(_line(state))


def _corrected(state: TrainingState, views: Views) -> Views:
    """Views outside the training, with the corrections of the training views before and after."""
    if state.corrections is None:
        return views
    return applied(views, state.corrections.values_at(views.frame), state.corrections.compression)


def _line(state: TrainingState) -> str:
    curves = state.curves
    loss = f"loss {curves.loss[-1]:.4f}, " if curves.loss else ""
    # A fit would take longer than the evaluation, and scores of other poses are other scores.
    poses = "as given" if state.corrections is None else "corrected as the frames before and after"
    shown: list[tuple[str, float, Callable[[float], str]]] = [
        (f"held-out frames {poses}: PSNR", curves.psnr[-1], "{:.2f} dB".format),
        ("SSIM", curves.ssim[-1], "{:.3f}".format),
    ]
    scores = "".join(f"{name} {form(value)}, " for name, value, form in shown if not math.isnan(value))
    return f"iteration {state.iteration}: {loss}{scores}{state.gaussians.count} Gaussians"

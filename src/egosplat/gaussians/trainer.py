"""The training loop of 3DGS (Kerbl et al. 2023): one photograph an iteration.

The order within an iteration is EgoLifter's and gsplat's: render, loss, gradients, the optimizer's step,
then density control. (The first 3DGS code changes the Gaussians before the step, which thereby skips those
that have just been made.)
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.errors import UserError
from egosplat.gaussians.evaluation import evaluate
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.options import TrainingOptions
from egosplat.gaussians.render import render
from egosplat.gaussians.schedule import Schedule
from egosplat.gaussians.training_state import TrainingState
from egosplat.gaussians.training_views import Views
from egosplat.gaussians.view_dependence import settle_degree
from egosplat.progress import log, track

RECORD_EVERY = 10
"""Iterations a record; a checkpoint is written at one, too. On a GPU, reading the loss each time would cost."""

_BAD_RECORDS = 3
"""So many records in a row without a finite loss end training."""


@dataclass(frozen=True)
class Photographs:
    """The views by what they are for; see ``egosplat.gaussians.training_views.Split``.

    Attributes:
        training, validation, held_out: see there.
        aside: those that judge the SH degree where it is searched: the validation views, or some of the training
            views, which are not trained on until it is decided. Else none.
    """

    training: Views
    validation: Views
    held_out: Views
    aside: Views

    def trained_on(self, *, all_views: bool) -> NDArray[np.intp]:
        """Indices of the training views that are trained on, all of them or without those set aside."""
        return np.flatnonzero(all_views | ~np.isin(self.training.frame, self.aside.frame))


def resume_and_train(
    state: TrainingState, photographs: Photographs, options: TrainingOptions, checkpoint: Checkpoint
) -> None:
    """``train``, from the checkpoint on where there is one; an error of the user's removes it.

    Raises:
        UserError: as ``train``.
    """
    if (saved := checkpoint.load()) is not None:
        state.load_state_dict(saved)
        log(f"training goes on after iteration {state.iteration}")
    try:
        train(state, photographs, options, checkpoint)
    except UserError:
        checkpoint.remove()  # going on would lead to the same end
        raise


def train(
    state: TrainingState, photographs: Photographs, options: TrainingOptions, checkpoint: Checkpoint
) -> None:
    """Go on from ``state`` until the last iteration, or until nothing improves; changes ``state``.

    Raises:
        UserError: training diverges, or no Gaussian is left.
    """
    schedule = options.schedule
    started = time.perf_counter() - state.seconds
    rest = range(state.iteration + 1, options.iterations + 1)
    usable = photographs.trained_on(all_views=not state.degree_search.open)
    for iteration in track(rest, "training", unit="iteration"):
        iterate(state, photographs.training, usable, options, schedule)
        if state.degree_search.open and iteration >= schedule.densify_until:
            settle(state, photographs, options, schedule)
            usable = photographs.trained_on(all_views=True)
        last = iteration == options.iterations
        recorded = iteration % RECORD_EVERY == 0 or last
        if recorded:
            record(state)
        state.seconds = time.perf_counter() - started
        if iteration % options.evaluate_every == 0 or last:
            measure(state, photographs, options, schedule)
            if ends_early(state, schedule):
                log(f"no improvement in {options.patience} evaluations: training ends")
                return
        if recorded:
            checkpoint.save_if_due(state.state_dict)


def iterate(
    state: TrainingState,
    views: Views,
    usable: Sequence[int],
    options: TrainingOptions,
    schedule: Schedule,
) -> None:
    """One iteration with one of the ``usable`` views: changes ``state``, and adds its loss to ``state.loss_sum``."""
    iteration = state.iteration + 1
    index = state.next_view(usable)
    state.optimizer.means_lr = schedule.position_lr(iteration, state.extent)
    state.optimizer.zero_grad()
    image, _, meta = render(
        state.gaussians,
        views.camera,
        views.camera_to_world[index],
        options.render,
        sh_degree=schedule.sh_degree(iteration, state.gaussians.sh_degree),
        background=draw_background(options.render.background, state.generator),
    )
    loss = state.objective.loss(image, views, index)
    regulariser = regularisation(state.gaussians, state.population.opacity_reg, state.population.scale_reg)
    meta["means2d"].retain_grad()
    total = loss if regulariser is None else loss + regulariser
    total.backward()
    state.objective.step()
    radii = meta["radii"]
    state.population.observe(meta["means2d"].grad, radii, views.camera.width, views.camera.height)
    # A regulariser reaches every Gaussian, the loss only those in the picture.
    state.optimizer.step((radii > 0).all(dim=-1).any(dim=0) if regulariser is None else None)
    state.gaussians = state.population.step(iteration, state.gaussians, state.optimizer, state.generator)
    state.loss_sum += total.detach()
    state.iteration = iteration


def settle(
    state: TrainingState, photographs: Photographs, options: TrainingOptions, schedule: Schedule
) -> None:
    """Let the views set aside say which SH degree is enough; from then on they are trained on, too."""
    kept = settle_degree(
        state.degree_search,
        state.gaussians,
        schedule.sh_degree(state.iteration, state.gaussians.sh_degree),
        photographs.training,
        photographs.aside,
        options.render,
        options.min_improvement,
    )
    if kept is not state.gaussians:
        state.replace_sh(kept)
    state.order.clear()


def draw_background(kind: str, generator: torch.Generator) -> Tensor | None:
    """(3,) float32 colour of a training iteration; None for black."""
    if kind == "random":
        return torch.rand(3, generator=generator)
    return torch.ones(3) if kind == "white" else None


def regularisation(gaussians: Gaussians, opacity_reg: float, scale_reg: float) -> Tensor | None:
    """``opacity_reg`` times the mean opacity plus ``scale_reg`` times the mean scale; None where both are 0."""
    if not (opacity_reg or scale_reg):
        return None
    return opacity_reg * gaussians.opacities.mean() + scale_reg * gaussians.scales.mean()


def record(state: TrainingState) -> None:
    """Take the mean loss since the last record into the curves.

    Raises:
        UserError: it has not been finite several times in a row.
    """
    curves = state.curves
    before = curves.iteration[-1] if curves.iteration else 0
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


def measure(
    state: TrainingState, photographs: Photographs, options: TrainingOptions, schedule: Schedule
) -> None:
    """Evaluate, log the result and take it into the curves."""
    sh_degree = schedule.sh_degree(state.iteration, state.gaussians.sh_degree)
    held_out, validation = (
        evaluate(state.gaussians, views, options.render, sh_degree)
        for views in (photographs.held_out, photographs.validation)
    )
    curves = state.curves
    curves.evaluated.append(state.iteration)
    curves.psnr.append(held_out.mean_psnr)
    curves.ssim.append(held_out.mean_ssim)
    curves.validation_psnr.append(validation.mean_psnr)
    curves.seconds.append(round(state.seconds, 3))
    log(_line(state))


def ends_early(state: TrainingState, schedule: Schedule) -> bool:
    """Whether the last evaluation ends training; keeps the best Gaussians. Never without patience.

    Only what was measured after density control has ended counts: before, opacity resets and new Gaussians
    let the PSNR fall for a while.
    """
    psnr = state.curves.validation_psnr[-1]
    if not state.early_stop.patience or state.iteration < schedule.densify_until:
        return False
    return state.early_stop.observe(state.iteration, psnr, state.gaussians)


def _line(state: TrainingState) -> str:
    curves = state.curves
    loss = f"loss {curves.loss[-1]:.4f}, " if curves.loss else ""
    shown: list[tuple[str, float, Callable[[float], str]]] = [
        ("held-out PSNR", curves.psnr[-1], "{:.2f} dB".format),
        ("SSIM", curves.ssim[-1], "{:.3f}".format),
        ("validation PSNR", curves.validation_psnr[-1], "{:.2f} dB".format),
    ]
    scores = "".join(f"{name} {form(value)}, " for name, value, form in shown if not math.isnan(value))
    return f"iteration {state.iteration}: {loss}{scores}{state.gaussians.count} Gaussians"

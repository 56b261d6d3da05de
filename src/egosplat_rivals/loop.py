"""The training loop of every method that trains: one view an iteration; recorded, resumable, repeatable."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.errors import UserError
from egosplat.language.result import Curve
from egosplat.progress import log, track

# Iterations per record. Checkpoints are written at records only.
RECORD_EVERY = 10


@dataclass(frozen=True)
class Step:
    """One iteration.

    Attributes:
        view: index of its view.
        iteration: its number, from 1.
        draw: generator of all that is random.
    """

    view: int
    iteration: int
    draw: torch.Generator


class Trainee(nn.Module, ABC):
    """What a method trains: parameters, their optimizers, and the loss of an iteration.

    Attributes:
        optimizers: of all parameters; one without a gradient does not move.
        advice: what to do if training diverges.
    """

    optimizers: list[torch.optim.Optimizer]
    advice = "lower language.lr"

    @abstractmethod
    def loss(self, step: Step) -> Tensor:
        """Return the () loss of an iteration; may set learning rates."""


def adam(groups: Iterable[tuple[Iterable[nn.Parameter], float]]) -> torch.optim.Adam:
    """Adam for numbers of Gaussians, from parameters and their learning rate."""
    parts = [{"params": list(parameters), "lr": rate} for parameters, rate in groups]
    fused = all(one.device.type in ("cpu", "cuda") for part in parts for one in part["params"])
    # Epsilon as in 3DGS: gradients of single Gaussians are tiny.
    return torch.optim.Adam(parts, eps=1e-15, fused=fused)


def train(trainee: Trainee, views: int, iterations: int, seed: int, checkpoint: Checkpoint) -> Curve:
    """Train to the last iteration, from the checkpoint if there is one.

    A killed training that goes on ends with the same parameters (on a GPU up to the order of sums).

    Args:
        trainee: holds the result afterwards.
        views: number of views. Each is taken once before any is taken again.
        seed: of the order of views, and of what the loss draws.

    Raises:
        UserError: training diverges. The checkpoint is removed, because resuming would diverge again.
    """
    training = Training(trainee, views, iterations, seed)
    if (saved := checkpoint.load()) is not None:
        training.load_state_dict(saved)
        log(f"training of codes resumes after iteration {training.iteration}")
    try:
        training.run(checkpoint)
    except UserError:
        checkpoint.remove()
        raise
    return training.curve


class Training:
    """State of a training; ``iteration`` is the last one done, ``curve`` its records."""

    def __init__(self, trainee: Trainee, views: int, iterations: int, seed: int) -> None:
        """Start a training; see ``train``."""
        self.curve = Curve()
        self.iteration = 0
        self._trainee, self._views, self._iterations = trainee, views, iterations
        self._draw = torch.Generator().manual_seed(seed)
        self._order: list[int] = []
        self._loss = next(trainee.parameters()).new_zeros(())

    def run(self, checkpoint: Checkpoint) -> None:
        """Train until the last iteration.

        Raises:
            UserError: training diverges.
        """
        rest = range(self.iteration + 1, self._iterations + 1)
        for iteration in track(rest, "training codes", unit="iteration"):
            self._iterate(iteration)
            self.iteration = iteration
            if iteration % RECORD_EVERY == 0 or iteration == self._iterations:
                self._record()
                checkpoint.save_if_due(self.state_dict)

    def _iterate(self, iteration: int) -> None:
        if not self._order:
            self._order = torch.randperm(self._views, generator=self._draw).tolist()
        for optimizer in self._trainee.optimizers:
            optimizer.zero_grad()
        loss = self._trainee.loss(Step(self._order.pop(), iteration, self._draw))
        loss.backward()
        for optimizer in self._trainee.optimizers:
            optimizer.step()
        self._loss += loss.detach()

    def _record(self) -> None:
        before = self.curve.iteration[-1] if self.curve.iteration else 0
        # Reading the sum waits for the GPU, so it is read at records only.
        loss = float(self._loss) / (self.iteration - before)
        self._loss.zero_()
        finite = math.isfinite(loss) and all(
            bool(part.isfinite().all()) for part in self._trainee.parameters()
        )
        if not finite:
            advice = self._trainee.advice
            raise UserError(f"training of codes diverged at iteration {self.iteration}; {advice}")
        self.curve.iteration.append(self.iteration)
        self.curve.loss.append(loss)

    def state_dict(self) -> dict[str, Any]:
        """Return the state for ``load_state_dict``."""
        return {
            "trainee": self._trainee.state_dict(),
            "optimizers": [optimizer.state_dict() for optimizer in self._trainee.optimizers],
            "generator": self._draw.get_state(),
            "order": list(self._order),
            "iteration": self.iteration,
            "curve": [list(self.curve.iteration), list(self.curve.loss)],
            "loss": self._loss,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state from ``state_dict``."""
        self._trainee.load_state_dict(state["trainee"])
        for optimizer, saved in zip(self._trainee.optimizers, state["optimizers"], strict=True):
            optimizer.load_state_dict(saved)
        self._draw.set_state(state["generator"])
        self._order, self.iteration = state["order"], state["iteration"]
        self.curve = Curve(*state["curve"])
        self._loss = state["loss"].to(self._loss.device)

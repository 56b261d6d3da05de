"""What methods train: small networks, and the loop of one view an iteration; recorded, resumable, repeatable."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.errors import UserError
from egosplat.language.decoder import Decoder, apply_layers, split_layers
from egosplat.language.options import LanguageOptions
from egosplat.language.views import CodeViews
from egosplat.progress import log, track
from egosplat.rasterize.view import pixel_renderer

# Iterations per record. Checkpoints are written at records only.
RECORD_EVERY = 10


@dataclass(frozen=True)
class Step:
    """One iteration: the index of its view, its number from 1, and the generator of all that is random."""

    view: int
    iteration: int
    draw: torch.Generator


class Trainee(nn.Module, ABC):
    """What a method trains on V views: parameters, their optimizers, and the loss of an iteration; advice if it diverges."""

    optimizers: list[torch.optim.Optimizer]
    advice = "use another run.seed"

    def __init__(self, views: CodeViews, options: LanguageOptions) -> None:
        """Take views, in each of which ``options.pixels`` are drawn where not the whole image is compared."""
        super().__init__()
        self.views, self.pixels = views, options.pixels

    @abstractmethod
    def loss(self, step: Step) -> Tensor:
        """Return the () loss of an iteration; may set learning rates."""

    def frame(self, view: int) -> int:
        """Index of a view in frames.zarr."""
        return int(self.views.frame[view])

    def draw_pixels(self, step: Step) -> tuple[Tensor, Tensor]:
        """Draw pixels that show the scene, each independently of the others: their expected loss is the whole image's.

        Returns (P, 2) int64 columns and rows on the CPU, and their (P,) float32 weights, see ``CodeViews.weight``.
        """
        weight, camera = self.views.weight(step.view), self.views.camera
        if weight is None:
            size = torch.tensor([camera.width, camera.height])
            pixels = (torch.rand(self.pixels, 2, generator=step.draw) * size).long()
            return pixels, torch.ones(self.pixels, device=self.views.device)
        allowed = weight.cpu().flatten().nonzero()[:, 0]
        if not len(allowed):
            return torch.zeros(0, 2, dtype=torch.int64), weight.new_zeros(0)
        chosen = allowed[torch.randint(len(allowed), (self.pixels,), generator=step.draw)]
        pixels = torch.stack([chosen % camera.width, chosen // camera.width], dim=1)
        return pixels, weight.flatten()[chosen.to(weight.device)]

    def render(self, view: int, pixels: Tensor, values: Tensor) -> Tensor:
        """(P, C) of (N, C) values of the Gaussians at (P, 2) pixels of a view."""
        return pixel_renderer(self.views.view(view), pixels)(values)


class Layers(nn.Module):
    """A decoder in training, without the normalization at the end; ``values`` are all weights and biases."""

    def __init__(self, widths: tuple[int, ...], seed: int, device: torch.device, **more: Any) -> None:
        """Start from random weights of ``seed``; the other arguments are those of ``Decoder``."""
        super().__init__()
        self._described = Decoder(widths, np.zeros(0, np.float32), **more)
        draw = torch.Generator().manual_seed(seed)
        # Uniform within one over the root of a layer's inputs, as PyTorch's linear layers start.
        sizes = [(wide * (narrow + 1), narrow) for narrow, wide in pairwise(widths)]
        parts = [(2 * torch.rand(size, generator=draw) - 1) / narrow**0.5 for size, narrow in sizes]
        self.values = nn.Parameter(torch.cat(parts).to(device))

    def forward(self, codes: Tensor) -> Tensor:
        """(..., C) codes -> (..., D)."""
        return apply_layers(codes, split_layers(self.values, self._described.widths), self._described)

    def trained(self) -> Decoder:
        """The decoder with the weights of now."""
        return replace(self._described, values=self.values.detach().cpu().numpy())


def adam(groups: Iterable[tuple[Iterable[nn.Parameter], float]]) -> torch.optim.Adam:
    """Adam for numbers of Gaussians, from parameters and their learning rate."""
    parts = [{"params": list(parameters), "lr": rate} for parameters, rate in groups]
    fused = all(one.device.type in ("cpu", "cuda") for part in parts for one in part["params"])
    # Epsilon as in 3DGS: gradients of single Gaussians are tiny.
    return torch.optim.Adam(parts, eps=1e-15, fused=fused)


def train(
    trainee: Trainee, views: int, iterations: int, seed: int, checkpoint: Checkpoint
) -> list[tuple[int, float]]:
    """Train to the last iteration, from the checkpoint if there is one; each of the views is taken once before any is again.

    A killed training that goes on ends with the same parameters (on a GPU up to the order of sums). UserError if it diverges;
    the checkpoint is then removed, because resuming would diverge again.
    """
    training = _Training(trainee, views, seed)
    if (saved := checkpoint.load()) is not None:
        training.load_state_dict(saved)
        log(f"training of codes resumes after iteration {training.recorded}")
    for iteration in track(range(training.recorded + 1, iterations + 1), "training codes", unit="iteration"):
        training.iterate(iteration)
        if iteration % RECORD_EVERY == 0 or iteration == iterations:
            if not training.record(iteration):
                checkpoint.remove()
                raise UserError(f"training of codes diverged at iteration {iteration}; {trainee.advice}")
            checkpoint.save_if_due(training.state_dict)
    return training.curve


class _Training:
    """State of a training; its ``curve`` has the records."""

    def __init__(self, trainee: Trainee, views: int, seed: int) -> None:
        self.curve: list[tuple[int, float]] = []
        self._trainee, self._views = trainee, views
        self._draw = torch.Generator().manual_seed(seed)
        self._order: list[int] = []
        self._loss = next(trainee.parameters()).new_zeros(())

    @property
    def recorded(self) -> int:
        """The iteration of the last record; 0 without any."""
        return self.curve[-1][0] if self.curve else 0

    def iterate(self, iteration: int) -> None:
        if not self._order:
            self._order = torch.randperm(self._views, generator=self._draw).tolist()
        for optimizer in self._trainee.optimizers:
            optimizer.zero_grad()
        loss = self._trainee.loss(Step(self._order.pop(), iteration, self._draw))
        loss.backward()
        for optimizer in self._trainee.optimizers:
            optimizer.step()
        self._loss += loss.detach()

    def record(self, iteration: int) -> bool:
        """Record the mean loss since the last record; whether it and all parameters are finite."""
        # Reading the sum waits for the GPU, so it is read at records only.
        loss = float(self._loss) / (iteration - self.recorded)
        self._loss.zero_()
        self.curve.append((iteration, loss))
        parameters = self._trainee.parameters()
        return math.isfinite(loss) and all(bool(values.isfinite().all()) for values in parameters)

    def state_dict(self) -> dict[str, Any]:
        return {
            "trainee": self._trainee.state_dict(),
            "optimizers": [optimizer.state_dict() for optimizer in self._trainee.optimizers],
            "generator": self._draw.get_state(),
            "order": list(self._order),
            "curve": list(self.curve),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._trainee.load_state_dict(state["trainee"])
        for optimizer, saved in zip(self._trainee.optimizers, state["optimizers"], strict=True):
            optimizer.load_state_dict(saved)
        self._draw.set_state(state["generator"])
        self._order, self.curve = state["order"], state["curve"]


def fewer_iterations(done: int, published: int, of: str = "") -> tuple[str, ...]:
    """The stand-in of a shorter training than the authors'; none for one as long. ``of`` follows "iterations"."""
    return () if done >= published else (f"{done:,} of {published:,} iterations{of}",)

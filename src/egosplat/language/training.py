"""Train codes by gradient descent with fixed geometry: LangSplat's second stage, for all levels at once."""

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from egosplat.artifacts.checkpoint import Checkpoint
from egosplat.codes.joint_objective import code_l1
from egosplat.codes.rendering import render_values
from egosplat.codes.targets import CodeTargets
from egosplat.errors import UserError
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings
from egosplat.language.lifting import lift
from egosplat.language.result import Coded, Curve
from egosplat.language.views import CodeViews
from egosplat.progress import log, track

# Iterations per record. Checkpoints are written at records only.
RECORD_EVERY = 10


@dataclass(frozen=True)
class CodeOptions:
    """Training options of the codes.

    Attributes:
        iterations: one view each.
        lr: Adam's learning rate.
        normalize_codes: normalize each Gaussian's code of a level before rendering (docs/method.md#code-norm).
        seed: for the order of views.
    """

    iterations: int
    lr: float
    normalize_codes: bool
    seed: int


def trained(
    gaussians: Gaussians,
    views: CodeViews,
    settings: RenderSettings,
    targets: CodeTargets,
    options: CodeOptions,
    checkpoint: Checkpoint,
) -> Coded:
    """Method ``trained``: codes by gradient descent, from the last checkpoint if there is one; shares of ``lift``.

    Raises:
        UserError: training diverges. The checkpoint is removed, because resuming would diverge again.
    """
    share = lift(gaussians, views, settings).share
    training = CodeTraining(gaussians, len(targets.levels), targets.channels, options)
    if (saved := checkpoint.load()) is not None:
        training.load_state_dict(saved)
        log(f"training of codes resumes after iteration {training.iteration}")
    try:
        training.run(gaussians, views, settings, checkpoint)
    except UserError:
        checkpoint.remove()
        raise
    # Stored as they are rendered, so that queries need not know whether codes are normalized.
    code = codes_to_render(training.code.detach(), options.normalize_codes)
    return Coded(code, share, targets.levels, curve=training.curve)


class CodeTraining:
    """State of the training of codes.

    Attributes:
        code: (N, L, C) leaf.
    """

    def __init__(self, gaussians: Gaussians, levels: int, channels: int, options: CodeOptions) -> None:
        """Start from zero codes, as LangSplat does."""
        shape = (gaussians.count, levels, channels)
        self.code = torch.zeros(shape, device=gaussians.means.device, requires_grad=True)
        self.curve = Curve()
        self.iteration = 0
        self._options = options
        # Epsilon as in 3DGS: gradients of single Gaussians are tiny.
        self._adam = torch.optim.Adam([self.code], lr=options.lr, eps=1e-15)
        self._generator = torch.Generator().manual_seed(options.seed)
        self._order: list[int] = []
        self._loss = self.code.new_zeros(())

    def run(
        self, gaussians: Gaussians, views: CodeViews, settings: RenderSettings, checkpoint: Checkpoint
    ) -> None:
        """Train until the last iteration.

        Raises:
            UserError: training diverges.
        """
        rest = range(self.iteration + 1, self._options.iterations + 1)
        for iteration in track(rest, "training codes", unit="iteration"):
            self._iterate(gaussians, views, settings)
            self.iteration = iteration
            if iteration % RECORD_EVERY == 0 or iteration == self._options.iterations:
                self._record()
                checkpoint.save_if_due(self.state_dict)

    def _iterate(self, gaussians: Gaussians, views: CodeViews, settings: RenderSettings) -> None:
        if not self._order:
            self._order = torch.randperm(len(views), generator=self._generator).tolist()
        index = self._order.pop()
        targets = views.targets(int(views.frame[index]))
        self._adam.zero_grad()
        values = codes_to_render(self.code, self._options.normalize_codes).flatten(1)
        image, _ = render_values(gaussians, values, views.camera, views.camera_to_world[index], settings)
        codes = image.permute(2, 0, 1).unflatten(0, targets.codes.shape[:2])
        loss = code_l1(codes, targets, views.weight(index))
        loss.backward()
        self._adam.step()
        self._loss += loss.detach()

    def _record(self) -> None:
        before = self.curve.iteration[-1] if self.curve.iteration else 0
        # Reading the sum waits for the GPU, so it is read at records only.
        loss = float(self._loss) / (self.iteration - before)
        self._loss.zero_()
        if not (math.isfinite(loss) and bool(self.code.isfinite().all())):
            raise UserError(f"training of codes diverged at iteration {self.iteration}; lower language.lr")
        self.curve.iteration.append(self.iteration)
        self.curve.loss.append(loss)

    def state_dict(self) -> dict[str, Any]:
        """Return the state for ``load_state_dict``."""
        return {
            "code": self.code.detach(),
            "adam": self._adam.state_dict(),
            "generator": self._generator.get_state(),
            "order": list(self._order),
            "iteration": self.iteration,
            "curve": [list(self.curve.iteration), list(self.curve.loss)],
            "loss": self._loss,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state from ``state_dict``."""
        with torch.no_grad():
            self.code.copy_(state["code"])
        self._adam.load_state_dict(state["adam"])
        self._generator.set_state(state["generator"])
        self._order, self.iteration = state["order"], state["iteration"]
        self.curve = Curve(*state["curve"])
        self._loss = state["loss"].to(self.code.device)


def codes_to_render(code: Tensor, normalize_codes: bool) -> Tensor:
    """(N, L, C) codes as rendered: normalized if ``normalize_codes``; zero codes stay 0."""
    # Codes start at 0, where the norm has no gradient; eps keeps it finite.
    return torch.nn.functional.normalize(code, dim=-1, eps=1e-9) if normalize_codes else code

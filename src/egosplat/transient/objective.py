"""The loss that trains H and temporary Gaussians together (the paper's initialization stage), and the unit of its penalty."""

from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.optim.adam import adam

from egosplat.arrays import Array, Bools
from egosplat.gaussians.loss import Objective, l2
from egosplat.gaussians.training_views import Views
from egosplat.transient.network import TransientNet
from egosplat.transient.options import TransientOptions

# A pixel stands out if its squared difference is larger than this many medians of its frame. In ten synthetic apartments
# the median of moving pixels is 3 to 12 medians, and that of static ones 1 (benchmarks/transient/README.md).
STANDS_OUT = 3.5

# Variance of rounding to 8 bits: a smaller residual says nothing about the scene.
LEAST_SCALE = (1 / 255) ** 2 / 12

# Defaults of torch.optim.Adam. The class itself imports torch's compiler, which takes 3 to 10 seconds.
_AS_ADAM = {"beta1": 0.9, "beta2": 0.999, "eps": 1e-8, "weight_decay": 0.0}
_AS_ADAM |= {"amsgrad": False, "maximize": False}


class InitialObjective(Objective):
    """L_init = mean over pixels of (1 - M) d_I + penalty |M|, with d_I the squared difference.

    Attributes:
        net: H.
        residuals: of the views at their last visit in the warm-up, or at their first one after it. Empty if the penalty
            is absolute.
    """

    advice = "lower transient.lr, or raise run.near_plane"

    def __init__(self, net: TransientNet, options: TransientOptions, device: torch.device) -> None:
        """Move ``net`` to ``device``, the device of the Gaussians, and train it in place."""
        self.net = net.to(device).train()
        # Listed once: a walk through all layers takes as long as a step of Adam.
        self._weights = list(self.net.parameters())
        self._options = options
        self._warmup = round(options.warmup * options.iterations)
        # The tests' device has no fused step. Without it, a step on a CPU takes three times as long.
        fused = device.type in ("cpu", "cuda")
        self._adam = partial(adam, lr=options.lr, fused=fused, **_AS_ADAM)
        self._moments = [[torch.zeros_like(weight) for weight in self._weights] for _ in range(2)]
        self._steps = [torch.zeros((), device=device if fused else None) for _ in self._weights]
        self._probability = torch.zeros(options.iterations, device=device)
        self._iteration = 0
        self.residuals = ResidualScale(device)

    def loss(self, image: Tensor, views: Views, index: int) -> Tensor:
        """Return L_init of one image; see ``egosplat.gaussians.loss.Objective``."""
        picture = views.picture(index)
        # The paper has the sum over R, G and B; the mean is EgoLifter's.
        factor = 3.0 if self._options.recipe == "paper" else 1.0
        self._iteration += 1
        # Pixels that the frame's own mask leaves out have no weight.
        shown = views.weight(index)
        in_residuals, penalty = self._options.recipe == "own", self._options.transient_penalty
        if in_residuals and (self._warming_up or not self.residuals.has(index)):
            squared = factor * (image.detach() - picture).square().mean(-1)
            self.residuals.measure(index, len(views), squared, shown)
        if self._warming_up:
            return factor * l2(image, picture, shown)
        probability = self.net(picture, *picture.shape[:2])
        self._probability[self._iteration - 1] = probability.detach().mean()
        # Not detached: L_init trains H through this weight.
        static = 1.0 - probability
        weight = static if shown is None else shown * static
        # Nor are they static: H is not told to call them so.
        own = None if views.transient is None else views.transient[index].to(probability.device)
        told = probability if own is None else probability.masked_fill(own, 0.0)
        # For a constant residual e of a pixel, the optimum is M = 0 if e < penalty, else 1
        # (docs/method.md#transient-loss). H only approaches it, depending on learning rate and iterations.
        unit = self.residuals.unit(index) if in_residuals else 1.0
        return factor * l2(image, picture, weight) + penalty * unit * told.mean()

    @torch.no_grad()
    def step(self) -> None:
        """Update H, except during warm-up and if a gradient is not finite."""
        if self._warming_up:
            return
        grads = [weight.grad for weight in self._weights if weight.grad is not None]
        # One step with NaN would make all later predictions NaN.
        if bool(torch.nn.utils.get_total_norm(grads).isfinite()):
            self._adam(self._weights, grads, *self._moments, [], self._steps)
        for weight in self._weights:
            weight.grad = None

    def mean_probability(self, iterations: list[int]) -> Array:
        """Return the mean M between consecutive ``iterations``, from iteration 0 on; 0 during warm-up."""
        means = self._probability.cpu().double().numpy()
        return np.array([means[a:b].mean() for a, b in pairwise([0, *iterations])])

    def state_dict(self) -> dict[str, Any]:
        """Return H, its optimizer, the residuals, the curve and the iteration, for ``load_state_dict``."""
        return {
            "net": dict(self.net.state_dict()),
            "adam": [*self._moments, self._steps],
            "probability": self._probability,
            "iteration": self._iteration,
            "residuals": self.residuals.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state from ``state_dict``."""
        self.net.load_state_dict(state["net"])
        *self._moments, self._steps = state["adam"]
        self._probability = state["probability"]
        self._iteration = state["iteration"]
        self.residuals.load_state_dict(state["residuals"])

    @property
    def _warming_up(self) -> bool:
        return self._iteration <= self._warmup


class ResidualScale:
    """Residuals of V views while the Gaussians are trained on all pixels, those that move too. ``scale`` is
    the (V,) float32 median squared difference of each view; NaN if it was not measured."""

    def __init__(self, device: torch.device) -> None:
        """Start without views; their number and size follow from the first measurement."""
        self.scale = torch.empty(0, device=device)
        # A bit a pixel: 3,600 views of 1408 x 1408 pixels take 0.9 GB.
        self._stands_out = torch.empty((0, 0), dtype=torch.uint8, device=device)
        self._size = 0, 0
        self._measured: set[int] = set()

    def has(self, index: int) -> bool:
        """Whether view ``index`` was measured."""
        return index in self._measured

    @torch.no_grad()
    def measure(self, index: int, views: int, residual: Tensor, shown: Tensor | None) -> None:
        """Replace the measurement of one of so many views. ``residual`` is the (H, W) squared difference to
        the render; one that is not finite is left out, as where ``shown`` is 0."""
        if not len(self.scale):
            self.scale = residual.new_full((views,), torch.nan)
            self._stands_out = residual.new_zeros((views, -(-residual.numel() // 8)), dtype=torch.uint8)
            self._size = residual.shape[0], residual.shape[1]
        counts = residual.isfinite() if shown is None else residual.isfinite() & (shown > 0)
        # NaN instead of a selection, whose unknown size would make the CPU wait for a GPU.
        residual = torch.where(counts, residual, torch.nan)
        self.scale[index] = residual.nanmedian()
        self._stands_out[index] = pack(residual > STANDS_OUT * self.scale[index].clamp_min(LEAST_SCALE))
        self._measured.add(index)

    def stands_out(self, index: int) -> Bools:
        """(H, W) pixels whose squared difference exceeds ``STANDS_OUT`` scales of their view."""
        height, width = self._size
        bits = np.unpackbits(self._stands_out[index].cpu().numpy(), count=height * width)
        return bits.astype(bool).reshape(height, width)

    def unit(self, index: int) -> Tensor:
        """() residual of static pixels in a view: the median of the view or of all views, whichever is
        larger. A view that is blurred or of another exposure has a larger median, and is not transient as a
        whole. A view that is easy to render has a smaller one, and the scene's median holds."""
        # fmax and nanmedian leave out NaN.
        return torch.fmax(self.scale[index], self.scale.nanmedian()).nan_to_num(0.0).clamp_min(LEAST_SCALE)

    def state_dict(self) -> dict[str, Any]:
        """Return the state for ``load_state_dict``."""
        return {
            "scale": self.scale,
            "stands_out": self._stands_out,
            "size": list(self._size),
            "measured": sorted(self._measured),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state from ``state_dict``."""
        self.scale, self._stands_out = state["scale"], state["stands_out"]
        self._size = state["size"][0], state["size"][1]
        self._measured = set(state["measured"])


def pack(flags: Tensor) -> Tensor:
    """(H, W) bool as (ceil(H W / 8),) uint8 on the same device, in the order of ``numpy.packbits``."""
    bits = torch.nn.functional.pad(flags.flatten().to(torch.uint8), (0, -flags.numel() % 8)).reshape(-1, 8)
    places = torch.arange(7, -1, -1, dtype=torch.uint8, device=flags.device)
    return torch.bitwise_left_shift(bits, places).sum(dim=1, dtype=torch.uint8)

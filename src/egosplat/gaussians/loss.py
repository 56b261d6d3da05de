"""Image losses of training, and the objective of one image. Losses take a pixel weight in [0, 1]. At weight 0
the pixel has no residual, no gradient and no effect on the SSIM of its neighbors. Means are over all values,
whatever their weight. A render or target value that is not finite or exceeds 1e8 has weight 0, and so has a
pixel whose weight is not finite: no NaN reaches the Gaussians."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from egosplat.gaussians.training_views import Views
from egosplat.image_quality import WINDOW_RADIUS, structural_similarity
from egosplat.rasterize.kernels import library

# The denominator of SSIM contains fourth powers, which must stay finite in float32.
LARGEST_VALUE = 1e8


def l1_ssim(render: Tensor, target: Tensor, weight: Tensor | None, ssim_lambda: float) -> Tensor:
    """Return ``(1 - ssim_lambda) mean |x - y| + ssim_lambda (1 - mean SSIM(x, y))`` (Kerbl et al. 2023, equation 7).

    y is the target and ``x = y + weight * (render - y)``. SSIM (Wang et al. 2004) has the parameters of 3DGS: a Gaussian
    window of 11 x 11 px with standard deviation 1.5 px, zero padding, K1 = 0.01, K2 = 0.03, data range 1. Float32 tensors on
    the CPU use the compiled kernel if it is built. ValueError: shapes or dtypes do not match.

    Args:
        render: (H, W, 3) floating point; on the CPU fastest as a permuted view of planar (3, H, W).
        target, weight: (H, W, 3) in [0, 1]; (H, W), clamped to [0, 1], or None for ones.
    """
    _check(render, target, weight)
    if not _can_fuse(render, target, weight):
        return torch_l1_ssim(render, target, weight, ssim_lambda)
    from egosplat.rasterize.kernels.training import l1_ssim as fused

    return fused(render, target, weight, ssim_lambda)


def torch_l1_ssim(render: Tensor, target: Tensor, weight: Tensor | None, ssim_lambda: float) -> Tensor:
    """Plain torch version of ``l1_ssim``, for any device and differentiable by all tensors."""
    difference, y, weight = _cleaned(render, target, weight)
    # The weight moves the render towards the target before both terms: SSIM compares windows, not single pixels.
    x = y + weight * difference
    l1 = (x - y).abs().mean()
    if ssim_lambda == 0.0:
        return l1
    return (1.0 - ssim_lambda) * l1 + ssim_lambda * (
        1.0 - structural_similarity(x, y, padding=WINDOW_RADIUS).mean()
    )


def l2(render: Tensor, target: Tensor, weight: Tensor | None) -> Tensor:
    """Return the mean over all values of ``weight * (render - target)^2``; arguments and errors as ``l1_ssim``."""
    _check(render, target, weight)
    difference, _, weight = _cleaned(render, target, weight)
    return (weight * difference.square()).mean()


def _check(render: Tensor, target: Tensor, weight: Tensor | None) -> None:
    if render.ndim != 3 or render.shape[2] != 3:
        raise ValueError(f"render: shape {tuple(render.shape)}, not (H, W, 3)")
    wanted = {"target": (target, render.shape), "weight": (weight, render.shape[:2])}
    for name, (tensor, shape) in wanted.items():
        if tensor is not None and tensor.shape != shape:
            raise ValueError(f"{name}: shape {tuple(tensor.shape)}, not {tuple(shape)}")
    for name, tensor in {"render": render, "target": target, "weight": weight}.items():
        if tensor is not None and not tensor.is_floating_point():
            raise ValueError(f"{name}: {tensor.dtype} is not floating point")


def _can_fuse(render: Tensor, target: Tensor, weight: Tensor | None) -> bool:
    # The kernel computes the gradient by the render only.
    constants = [target] if weight is None else [target, weight]
    suits = all(t.device.type == "cpu" and t.dtype == torch.float32 for t in (render, *constants))
    return suits and not any(t.requires_grad for t in constants) and library.is_usable()


def _cleaned(render: Tensor, target: Tensor, weight: Tensor | None) -> tuple[Tensor, Tensor, Tensor]:
    """Return render minus target, target, and (H, W, 1) weight, all finite; the difference is 0 at broken values."""
    weight = render.new_ones(render.shape[:2]) if weight is None else weight
    target_is_sound = target.abs() <= LARGEST_VALUE  # NaN compares as False
    y = torch.where(target_is_sound, target, 0.0)
    difference = torch.where(target_is_sound & (render.abs() <= LARGEST_VALUE), render - y, 0.0)
    weight = torch.where(weight.abs() <= LARGEST_VALUE, weight.clamp(0.0, 1.0), 0.0)
    return difference, y, weight[:, :, None]


class Objective(ABC):
    """Compares a render with its photograph; ``advice`` names keys that the user may change if training diverges;
    ``features`` is the number of channels that it needs besides colors."""

    advice, features = "raise run.near_plane", 0

    @abstractmethod
    def loss(self, image: Tensor, views: Views, index: int) -> Tensor:
        """Return the () loss of one iteration, differentiable by ``image``, the (H, W, 3 + F) float32 colors and features."""

    def step(self) -> None:  # noqa: B027
        """Update the objective's own parameters, if any; called after each backward pass."""

    def state_dict(self) -> dict[str, Any]:
        """Return the state for ``load_state_dict``: tensors, numbers and strings, possibly nested."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:  # noqa: B027
        """Restore a state from ``state_dict``; its tensors are on the device of the Gaussians."""


@dataclass(frozen=True)
class L1Ssim(Objective):
    """The loss of 3DGS, weighted by 1 - M inside the lens circle. ``ssim_lambda`` is the share of 1 - SSIM, the rest L1."""

    ssim_lambda: float

    def loss(self, image: Tensor, views: Views, index: int) -> Tensor:
        """Return ``l1_ssim`` of the colors."""
        return l1_ssim(image[..., :3], views.picture(index), views.weight(index), self.ssim_lambda)

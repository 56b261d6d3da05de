"""What a render is compared with a photograph by: the loss of 3DGS, and the squared error.

Both take a weight for each pixel, between 1 and 0, where it is as if the render showed the photograph: the pixel
has no residual, does not spoil its neighbours' SSIM, and gets no gradient. Means are over all values, whatever
they weigh. So that no broken number ever enters the Gaussians, a value of render or target that is not finite,
or beyond 1e8, weighs 0, and so does a weight that is not finite.
"""

import torch
from torch import Tensor

from egosplat.image_quality import WINDOW_RADIUS, structural_similarity
from egosplat.kernels import library

LARGEST_VALUE = 1e8
"""The denominator of SSIM holds fourth powers, which are still finite in float32."""


def l1_ssim(render: Tensor, target: Tensor, weight: Tensor | None, ssim_lambda: float) -> Tensor:
    """``(1 - ssim_lambda) mean |x - y| + ssim_lambda (1 - mean SSIM(x, y))`` (Kerbl et al. 2023, equation 7).

    y is the target and ``x = y + weight * (render - y)``. SSIM (Wang et al. 2004) is that of 3DGS: Gaussian
    window of 11 x 11 pixels and standard deviation 1.5 px, zeros beyond the border, K1 = 0.01, K2 = 0.03, data
    range 1. On the CPU in float32 the compiled kernel computes it, where it is built.

    Args:
        render: (H, W, 3) floating point; on the CPU best a permuted view of planar (3, H, W).
        target: (H, W, 3) in [0, 1].
        weight: (H, W), clamped to [0, 1], or None for ones.
        ssim_lambda: share of the SSIM term.

    Returns:
        () tensor, differentiable.

    Raises:
        ValueError: shapes or dtypes that do not belong together.
    """
    _check(render, target, weight)
    if not _can_fuse(render, target, weight):
        return torch_l1_ssim(render, target, weight, ssim_lambda)
    from egosplat.kernels.loss import l1_ssim as fused

    return fused(render, target, weight, ssim_lambda)


def torch_l1_ssim(render: Tensor, target: Tensor, weight: Tensor | None, ssim_lambda: float) -> Tensor:
    """``l1_ssim`` in plain torch, on any device and differentiable by all tensors."""
    difference, y, weight = _cleaned(render, target, weight)
    x = y + weight * difference
    l1 = (x - y).abs().mean()
    return (1.0 - ssim_lambda) * l1 + ssim_lambda * (
        1.0 - structural_similarity(x, y, padding=WINDOW_RADIUS).mean()
    )


def l2(render: Tensor, target: Tensor, weight: Tensor | None) -> Tensor:
    """Mean over all values of ``weight * (render - target)^2``; arguments and errors as ``l1_ssim``."""
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
    constants = [target] if weight is None else [target, weight]
    suits = all(t.device.type == "cpu" and t.dtype == torch.float32 for t in (render, *constants))
    return suits and not any(t.requires_grad for t in constants) and library.is_usable()


def _cleaned(render: Tensor, target: Tensor, weight: Tensor | None) -> tuple[Tensor, Tensor, Tensor]:
    """Render less target, target, and (H, W, 1) weight: all finite, the difference 0 where one is broken."""
    weight = render.new_ones(render.shape[:2]) if weight is None else weight
    target_is_sound = target.abs() <= LARGEST_VALUE  # NaN compares as False
    y = torch.where(target_is_sound, target, 0.0)
    difference = torch.where(target_is_sound & (render.abs() <= LARGEST_VALUE), render - y, 0.0)
    weight = torch.where(weight.abs() <= LARGEST_VALUE, weight.clamp(0.0, 1.0), 0.0)
    return difference, y, weight[:, :, None]

"""The losses match their definition, ignore broken pixels, and use the kernel only where it is exact."""

import pytest
import torch
from torch import Tensor

from egosplat.gaussians import loss
from egosplat.gaussians.loss import l1_ssim, l2, torch_l1_ssim
from egosplat.image_quality import WINDOW_RADIUS, structural_similarity
from egosplat.rasterize.kernels import library


def pictures(height: int = 30, width: int = 26, dtype: torch.dtype = torch.float64) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(1)
    target = torch.rand(height, width, 3, generator=generator, dtype=dtype)
    noise = torch.randn(target.shape, generator=generator, dtype=dtype)
    return (target + 0.2 * noise).requires_grad_(), target


def test_ssim_is_torchmetrics_within_the_picture() -> None:
    from torchmetrics.functional.image import structural_similarity_index_measure

    # At the border torchmetrics mirrors the picture, where 3DGS has zeros.
    render, target = pictures()
    images = [picture.detach().permute(2, 0, 1)[None] for picture in (render, target)]
    options = {"sigma": 1.5, "data_range": 1.0, "return_full_image": True}
    wanted = structural_similarity_index_measure(*images, **options)[1][0].permute(1, 2, 0)
    mine = structural_similarity(render.detach(), target, padding=WINDOW_RADIUS)
    torch.testing.assert_close(mine[5:-5, 5:-5], wanted[5:-5, 5:-5], rtol=1e-5, atol=1e-5)


def test_value_of_a_picture_that_is_known() -> None:
    # One pixel: the window's center weighs w^2 and everything else is zero.
    x, y = torch.full((1, 1, 3), 0.5), torch.full((1, 1, 3), 0.25)
    w = 0.2660117248617943**2
    variance = (w - w * w) * (0.5**2 + 0.25**2)
    luminance = (2 * w * w * 0.125 + 1e-4) / (w * w * (0.5**2 + 0.25**2) + 1e-4)
    ssim = luminance * (2 * (w - w * w) * 0.125 + 9e-4) / (variance + 9e-4)
    for function in (l1_ssim, torch_l1_ssim):
        assert function(x, y, None, 0.2).item() == pytest.approx(0.8 * 0.25 + 0.2 * (1 - ssim), rel=1e-6)
        assert function(x, y, None, 0.0).item() == pytest.approx(0.25)
        assert function(y, y, None, 0.2).item() == pytest.approx(0.0, abs=1e-7)


def test_gradients_of_the_definition_hold() -> None:
    render, target = pictures(6, 7)
    weight = torch.linspace(0.1, 0.9, 42, dtype=torch.float64).view(6, 7).requires_grad_()
    target.requires_grad_()
    for function in (lambda *a: torch_l1_ssim(*a, 0.2), l2):
        # In random directions: one for each number takes fifty times as long.
        assert torch.autograd.gradcheck(function, (render, target, weight), fast_mode=True)


@pytest.mark.parametrize("function", [lambda *a: torch_l1_ssim(*a, 0.2), lambda *a: l1_ssim(*a, 0.2), l2])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_pixels_of_weight_zero_are_ignored(function: object, dtype: torch.dtype) -> None:
    render, target = pictures(dtype=dtype)
    weight = torch.ones(target.shape[:2], dtype=dtype)
    weight[10:14, 3:9] = 0.0
    repainted = torch.where(weight[:, :, None] == 0, 0.7, render.detach()).requires_grad_()
    values = [function(each, target, weight) for each in (render, repainted)]
    gradients = [torch.autograd.grad(v, each)[0] for v, each in zip(values, (render, repainted), strict=True)]
    assert torch.equal(*values) and torch.equal(*gradients)
    assert not gradients[0][weight == 0].any() and gradients[0][weight == 1].all()


def test_weights_outside_of_their_range_are_clamped() -> None:
    render, target = pictures(dtype=torch.float32)
    weight = torch.linspace(-1.0, 2.0, target.shape[0] * target.shape[1]).view(target.shape[:2])
    for function in (torch_l1_ssim, l1_ssim):
        wanted = function(render, target, weight.clamp(0.0, 1.0), 0.2)
        assert torch.equal(function(render, target, weight, 0.2), wanted)


def test_l2_is_the_weighted_mean_over_all_values() -> None:
    render, target = pictures()
    weight = torch.rand(target.shape[:2], dtype=torch.float64)
    wanted = (weight[:, :, None] * (render - target) ** 2).sum() / target.numel()
    torch.testing.assert_close(l2(render, target, weight), wanted)
    torch.testing.assert_close(l2(render, target, None), ((render - target) ** 2).mean())


def test_the_kernel_is_used_only_if_all_gradients_are_available(monkeypatch: pytest.MonkeyPatch) -> None:
    if library.why_not() is not None:
        pytest.skip("the kernels are not built")
    used = []
    monkeypatch.setattr(loss, "torch_l1_ssim", lambda *arguments: used.append(True))
    render, target = pictures(dtype=torch.float32)
    weight = torch.ones(target.shape[:2])
    assert l1_ssim(render, target, weight, 0.2).requires_grad and not used
    l1_ssim(render, target, weight.requires_grad_(), 0.2)
    l1_ssim(render.double(), target.double(), None, 0.2)
    assert len(used) == 2


def test_mismatched_shapes_are_rejected() -> None:
    render, target = pictures(dtype=torch.float32)
    for function in (l2, lambda *arguments: l1_ssim(*arguments, 0.2)):
        with pytest.raises(ValueError, match=r"render: .*\(30, 26\)"):
            function(render[:, :, 0], target, None)
        with pytest.raises(ValueError, match=r"target: .*\(29, 26, 3\)"):
            function(render, target[1:], None)
        with pytest.raises(ValueError, match=r"weight: .*\(30, 26, 3\)"):
            function(render, target, torch.ones_like(target))
        with pytest.raises(ValueError, match="target: torch.uint8"):
            function(render, target.byte(), None)

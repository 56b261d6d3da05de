"""The fused loss equals the definition's value and gradient for any size, number of threads and processor."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from egosplat.gaussians.loss import torch_l1_ssim
from egosplat.rasterize.kernels import library
from egosplat.rasterize.kernels.loss import l1_ssim

pytestmark = pytest.mark.skipif(library.why_not() is not None, reason="the kernels are not built")

SIZES = [(1, 1), (1, 40), (40, 1), (5, 7), (11, 11), (16, 16), (33, 65), (70, 9), (8, 100)]


def pictures(height: int, width: int, seed: int = 0) -> tuple[Tensor, Tensor, Tensor]:
    """A render as the rasterizer returns it, a similar photograph, and weights of which a third are 0."""
    generator = torch.Generator().manual_seed(seed)
    target = torch.rand(height, width, 3, generator=generator)
    noise = torch.randn(3, height, width, generator=generator).permute(1, 2, 0)
    weight = torch.rand(height, width, generator=generator)
    render = (target.permute(2, 0, 1).contiguous().permute(1, 2, 0) + 0.2 * noise).requires_grad_()
    return render, target, torch.where(weight < 0.3, 0.0, weight)


def value_and_gradient(render: Tensor, target: Tensor, weight: Tensor | None) -> tuple[Tensor, Tensor]:
    loss = l1_ssim(render, target, weight, 0.2)
    (gradient,) = torch.autograd.grad(loss, render)
    return loss, gradient


def in_double(render: Tensor, target: Tensor, weight: Tensor | None) -> tuple[Tensor, Tensor]:
    """Value and gradient of the definition in float64."""
    leaf = render.detach().double().requires_grad_()
    loss = torch_l1_ssim(leaf, target.double(), None if weight is None else weight.double(), 0.2)
    return loss, torch.autograd.grad(loss, leaf)[0]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("weighted", [False, True])
def test_value_and_gradient_equal_the_definition_with_any_number_of_threads(
    size: tuple[int, int], weighted: bool, with_threads: Callable[..., tuple[Tensor, Tensor]]
) -> None:
    render, target, weight = pictures(*size)
    if size == (1, 1):
        weight.fill_(0.5)
    chosen = weight if weighted else None
    loss, gradient = value_and_gradient(render, target, chosen)
    wanted, wanted_gradient = in_double(render, target, chosen)
    assert loss.item() == pytest.approx(wanted.item(), rel=1e-6)
    assert (gradient - wanted_gradient).norm() < 1e-6 * wanted_gradient.norm()
    for count in (1, 2, 5):
        other = with_threads(count, value_and_gradient, render, target, chosen)
        assert torch.equal(other[0], loss) and torch.equal(other[1], gradient)


def test_gradients_scale_with_the_factor_and_the_value_needs_none() -> None:
    render, target, weight = pictures(12, 20)
    loss, gradient = value_and_gradient(render, target, weight)
    (scaled,) = torch.autograd.grad(3.0 * l1_ssim(render, target, weight, 0.2), render)
    torch.testing.assert_close(scaled, 3.0 * gradient)
    with torch.no_grad():
        value = l1_ssim(render, target, weight, 0.2)
    assert torch.equal(value, loss) and not value.requires_grad


def test_layouts_of_the_inputs_do_not_matter() -> None:
    render, target, weight = pictures(13, 21)
    expected = value_and_gradient(render, target, weight)
    packed = render.detach().contiguous().requires_grad_()
    planar = target.permute(2, 0, 1).contiguous().permute(1, 2, 0)
    result = value_and_gradient(packed, planar, weight.T.contiguous().T)
    assert torch.equal(result[0], expected[0]) and torch.equal(result[1], expected[1])

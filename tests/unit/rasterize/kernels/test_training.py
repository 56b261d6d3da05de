"""The fused loss and Adam step equal their definitions and torch's for any size, number of threads and processor."""

import math
from collections.abc import Callable, Sequence

import pytest
import torch
from torch import Tensor

from egosplat.gaussians.loss import torch_l1_ssim
from egosplat.rasterize.kernels import library
from egosplat.rasterize.kernels.training import adam_step, l1_ssim

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


def tensors(rows: int, columns: int) -> list[Tensor]:
    """A parameter with space for its gradient, and its moments."""
    param = torch.randn(rows, columns, generator=torch.Generator().manual_seed(3))
    return [param, *(torch.zeros(rows, columns) for _ in range(3))]


def gradients(rows: int, columns: int, step: int) -> Tensor:
    """Gradients of rows that come and go: in one of three steps, or never."""
    generator = torch.Generator().manual_seed(step)
    grad = torch.randn(rows, columns, generator=generator)
    row = torch.arange(rows)
    return torch.where(((row % 3 == step % 3) & (row % 7 != 0))[:, None], grad, 0.0)


def one_step(state: Sequence[Tensor], rates: float | Tensor, step: int) -> int:
    return adam_step([(*state, rates)], torch.ones(len(state[0]), dtype=torch.bool), step)


def steps(state: Sequence[Tensor], count: int, rates: float | Tensor = 0.01) -> None:
    for step in range(count):
        state[1].copy_(gradients(*state[0].shape, step))
        assert one_step(state, rates, step + 1) == 0


@pytest.mark.parametrize("rows", [0, 1, 15, 16, 5000])
@pytest.mark.parametrize("columns", [0, 1, 3, 4, 48])
def test_steps_equal_torch_adam(rows: int, columns: int) -> None:
    state = tensors(rows, columns)
    leaf = state[0].clone().requires_grad_()
    reference = torch.optim.Adam([leaf], lr=0.01, betas=(0.9, 0.999), eps=1e-15)
    for step in range(50):
        leaf.grad = gradients(rows, columns, step)
        reference.step()
    steps(state, 50)
    torch.testing.assert_close(state[0], leaf.detach(), rtol=1e-6, atol=1e-6)
    if rows * columns:
        for moments, name in zip(state[2:], ("exp_avg", "exp_avg_sq"), strict=True):
            torch.testing.assert_close(moments, reference.state[leaf][name], rtol=1e-5, atol=1e-7)


def test_rows_with_zero_gradient_and_moments_keep_their_bits() -> None:
    state = tensors(40, 3)
    before = state[0].clone()
    steps(state, 6)
    never = torch.arange(40) % 7 == 0
    assert torch.equal(state[0][never], before[never]) and not state[2][never].any()
    middle = state[0].clone()
    one_step([state[0], torch.zeros(40, 3), *state[2:]], 0.01, 7)
    assert torch.equal(state[0][never], before[never]) and (state[0][~never] != middle[~never]).all()


@pytest.mark.parametrize("rows", [5, 37])
def test_each_column_uses_its_own_learning_rate(rows: int) -> None:
    state, parts = tensors(rows, 12), [tensors(rows, 12) for _ in range(2)]
    rates = torch.tensor([0.02] * 3 + [0.001] * 9)
    steps(state, 5, rates)
    for part, lr in zip(parts, (0.02, 0.001), strict=True):
        steps(part, 5, lr)
    assert torch.equal(state[0], torch.cat([parts[0][0][:, :3], parts[1][0][:, 3:]], dim=1))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e30])
@pytest.mark.parametrize("row", [0, 20, 36])
def test_rows_with_a_non_finite_gradient_are_skipped_and_counted(value: float, row: int) -> None:
    state, sound = tensors(37, 5), tensors(37, 5)
    for each in (state, sound):
        steps(each, 3)
        each[1].copy_(torch.ones(37, 5))
    before = [tensor[row].clone() for tensor in state]
    state[1][row, 4] = value
    assert one_step(state, 0.01, 4) == 1
    assert one_step(sound, 0.01, 4) == 0
    others = torch.arange(37) != row
    for index in (0, 2, 3):
        assert torch.equal(state[index][row], before[index])
        assert torch.equal(state[index][others], sound[index][others])


def test_results_do_not_depend_on_the_number_of_threads(with_threads: Callable[..., None]) -> None:
    results = [tensors(101, 4) for _ in range(3)]
    for threads, result in zip((1, 2, 5), results, strict=True):
        with_threads(threads, steps, result, 4)
    for result in results[1:]:
        assert all(torch.equal(one, other) for one, other in zip(result, results[0], strict=True))

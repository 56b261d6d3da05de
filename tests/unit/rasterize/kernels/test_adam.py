"""The fused Adam step equals torch's for any rows, number of threads and processor."""

import math
from collections.abc import Callable, Sequence

import pytest
import torch
from torch import Tensor

from egosplat.rasterize.kernels import library
from egosplat.rasterize.kernels.adam import adam_step

pytestmark = pytest.mark.skipif(library.why_not() is not None, reason="the kernels are not built")


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

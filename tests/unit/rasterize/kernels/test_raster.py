"""Compositing with the kernels: threads, memory, and the state between forward and backward pass."""

import math

import pytest
import torch
from torch import Tensor

from egosplat.rasterize.kernels.raster import composite

WIDTH, HEIGHT = 150, 110


def projected(count: int, channels: int, seed: int = 0) -> dict[str, Tensor]:
    """Projected Gaussians across the image and outside it."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(low: float, high: float, *size: int) -> Tensor:
        return low + (high - low) * torch.rand(*size, generator=generator)

    spread, turn = uniform(0.5, 9.0, count, 2), uniform(-0.8, 0.8, count)
    uu, vv = spread.square().unbind(dim=-1)
    uv = turn * (uu * vv).sqrt()
    determinant = uu * vv - uv * uv
    return {
        "means2d": uniform(-20.0, 170.0, count, 2),
        "conics": torch.stack([vv, -uv, uu], dim=-1) / determinant[:, None],
        "depths": uniform(0.5, 5.0, count),
        "opacities": uniform(0.05, 0.95, count),
        "channels": uniform(0.0, 1.0, count, channels),
        "variances_y": vv,
        "radii": (3.4 * torch.stack([uu, vv], dim=-1).sqrt()).ceil().to(torch.int32),
        "background": uniform(0.0, 1.0, channels),
    }


def pull(values: dict[str, Tensor]) -> list[Tensor]:
    """The images and all gradients."""
    fixed = ("depths", "variances_y", "radii")
    inputs = {name: value.clone().requires_grad_(name not in fixed) for name, value in values.items()}
    render, alpha = composite(**inputs, width=WIDTH, height=HEIGHT)
    (render.square().sum() + alpha.sin().sum()).backward()
    return [render, alpha, *(value.grad for value in inputs.values() if value.grad is not None)]


@pytest.mark.parametrize("channels", [3, 20])
def test_every_number_of_threads_gives_the_same_bits(channels, with_threads):
    values = projected(3000, channels)
    first, *others = (with_threads(threads, pull, values) for threads in (1, 2, 3, 8))
    assert len(first) == 7
    for other in others:
        assert all(torch.equal(a, b) for a, b in zip(first, other, strict=True))


def test_two_forward_passes_before_their_backward_passes():
    values = [projected(3000, 12, seed=3), projected(10, 3, seed=4)]
    alone = [pull(value) for value in values]
    inputs = [{n: v.clone().requires_grad_(n == "channels") for n, v in each.items()} for each in values]
    renders = [composite(**each, width=WIDTH, height=HEIGHT)[0] for each in inputs]
    for render in reversed(renders):
        render.square().sum().backward()
    for each, expected in zip(inputs, alone, strict=True):
        torch.testing.assert_close(each["channels"].grad, expected[5], rtol=1e-6, atol=1e-6)


def test_the_backward_pass_can_run_again_and_of_alpha_alone():
    values = projected(300, 3)
    leaves = [values[name].requires_grad_() for name in ("opacities", "channels")]
    render, alpha = composite(**values, width=WIDTH, height=HEIGHT)
    first, second = (torch.autograd.grad(render.sum(), leaves, retain_graph=True) for _ in range(2))
    assert all(torch.equal(*pair) and pair[0].any() for pair in zip(first, second, strict=True))
    (alone,) = torch.autograd.grad(alpha.sum(), leaves[:1], retain_graph=True)
    (beside,) = torch.autograd.grad(alpha.sum() + 0 * render.sum(), leaves[:1])
    assert torch.equal(alone, beside) and alone.any()


def test_rows_of_pixels_without_a_gradient_add_nothing():
    """Outside the lens circle not even a Gaussian of infinite color does."""
    values = projected(500, 3)
    values["means2d"][0], values["conics"][0] = torch.tensor([20.5, 50.5]), torch.tensor([0.1, 0.0, 0.1])
    values["variances_y"][0], values["radii"][0], values["depths"][0] = 10.0, 11, 0.1
    weight = torch.randn(3, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(1))
    weight[:, :, :64] = 0.0

    def gradients(color: float) -> tuple[Tensor, ...]:
        values["channels"][0] = color
        leaves = [values[name].clone().requires_grad_() for name in ("means2d", "conics", "channels")]
        given = dict(zip(("means2d", "conics", "channels"), leaves, strict=True))
        render, _ = composite(**values | given, width=WIDTH, height=HEIGHT)
        return torch.autograd.grad(render, leaves, weight)

    found, expected = gradients(math.inf), gradients(0.5)
    assert all(torch.equal(a, b) and not a[0].any() and a.any() for a, b in zip(found, expected, strict=True))

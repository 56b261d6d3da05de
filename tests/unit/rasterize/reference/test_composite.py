"""Compositing equals a plain loop over pixels and Gaussians that follows the definition."""

import math

import pytest
import torch
from torch import Tensor

from egosplat.rasterize.reference.projection import Projected
from egosplat.rasterize.reference.rasterizer import composite

TOLERANCE = {torch.float32: 2e-5, torch.float64: 1e-12}


def loop(means2d, conics, opacities, channels, depths, width, height) -> tuple[Tensor, Tensor]:
    """Every Gaussian at every pixel in plain Python, without tiles and bounding rectangles."""
    image, alphas = (
        torch.zeros(height, width, channels.shape[1]).double(),
        torch.zeros(height, width).double(),
    )
    order = sorted(range(len(depths)), key=lambda index: depths[index].item())
    gaussians = [(means2d[i].tolist(), conics[i].tolist(), opacities[i].item(), channels[i]) for i in order]
    for row in range(height):
        for column in range(width):
            remaining = 1.0
            for (u, v), (a, b, c), opacity, channel in gaussians:
                dx, dy = column + 0.5 - u, row + 0.5 - v
                sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
                alpha = min(0.999, opacity * math.exp(-sigma))
                if sigma < 0 or alpha < 1 / 255:
                    continue
                if remaining * (1 - alpha) <= 1e-4:
                    break
                image[row, column] += remaining * alpha * channel
                remaining *= 1 - alpha
            alphas[row, column] = 1 - remaining
    return image, alphas


def random_gaussians(count: int, width: int, height: int, low: float, high: float, seed: int):
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, dtype=torch.float64, generator=generator)

    means2d = uniform(count, 2) * torch.tensor([width, height]) * 1.4 - torch.tensor([width, height]) * 0.2
    root = uniform(count, 2, 2) * 8 - 4
    covariances = root @ root.mT + 0.3 * torch.eye(2)
    opacities = low + (high - low) * uniform(count)
    extents = (2 * (255 * opacities).log()).sqrt()[:, None] * covariances.diagonal(dim1=1, dim2=2).sqrt()
    conics = covariances.inverse()[:, [0, 0, 1], [0, 1, 1]]
    return means2d, conics, opacities, uniform(count, 3), uniform(count), extents.ceil().int()


@pytest.mark.parametrize("dtype", TOLERANCE)
@pytest.mark.parametrize(
    ("count", "width", "height", "low", "high"),
    [(30, 37, 19, 0.05, 0.9), (60, 17, 33, 0.9, 1.0), (1, 16, 16, 0.5, 0.6), (40, 5, 3, 0.01, 0.05)],
)
def test_compositing_equals_a_plain_loop(count, width, height, low, high, dtype):
    *numbers, radii = random_gaussians(count, width, height, low, high, seed=count)
    means2d, conics, opacities, channels, depths = (each.to(dtype) for each in numbers)
    seen = Projected(means2d, conics, depths, radii, opacities)
    found, alpha = composite(seen, channels, width, height)
    expected, expected_alpha = loop(*numbers, width, height)
    torch.testing.assert_close(found.double(), expected, atol=TOLERANCE[dtype], rtol=0)
    torch.testing.assert_close(alpha[..., 0].double(), expected_alpha, atol=TOLERANCE[dtype], rtol=0)
    assert found.dtype == dtype and expected_alpha.max() > 0.01


@pytest.mark.parametrize(
    ("opacities", "depths", "color", "alpha"),
    [
        # Nearest first, and in order at equal depths.
        ([0.5, 0.25], [1.0, 2.0], 0.5 + 10 * 0.5 * 0.25, 1 - 0.5 * 0.75),
        ([0.5, 0.25], [2.0, 1.0], 10 * 0.25 + 0.75 * 0.5, 1 - 0.5 * 0.75),
        ([0.5, 0.25], [1.0, 1.0], 0.5 + 10 * 0.5 * 0.25, 1 - 0.5 * 0.75),
        # The third would be composited (0.001 * 0.5 > 1e-4) if the second had not ended the pixel.
        ([1.0, 1.0, 0.5], [1.0, 2.0, 3.0], 0.999, 0.999),
        ([1.0, 0.5], [1.0, 3.0], 0.999 + 10 * 0.0005, 0.9995),
        # Faint ones are skipped.
        ([0.99 / 255, 0.5], [1.0, 2.0], 5.0, 0.5),
        ([1.01 / 255], [1.0], 1.01 / 255, 1.01 / 255),
    ],
)
def test_order_end_and_limit_of_compositing(opacities, depths, color, alpha):
    """Of one pixel under wide Gaussians of colors 1, 10, 100, ..."""
    count = len(opacities)
    conics = torch.tensor([[0.01, 0.0, 0.01]]).double().expand(count, 3)
    colors = 10.0 ** torch.arange(count).double()[:, None]
    means2d, values = torch.full((count, 2), 0.5).double(), torch.tensor([depths, opacities]).double()
    seen = Projected(means2d, conics, values[0], torch.full((count, 2), 9), values[1])
    found = composite(seen, colors, 1, 1)
    assert (found[0].item(), found[1].item()) == pytest.approx((color, alpha))


@pytest.mark.parametrize(("opacity", "slope"), [(0.9985, 1.0), (0.9995, 0.0)])
def test_no_gradient_above_the_largest_alpha(opacity, slope):
    opacities = torch.tensor([opacity], dtype=torch.float64, requires_grad=True)
    mean, conic = torch.full((1, 2), 0.5).double(), torch.tensor([[0.01, 0.0, 0.01]]).double()
    seen = Projected(mean, conic, torch.ones(1), torch.ones(1, 2), opacities)
    composite(seen, torch.ones(1, 1).double(), 1, 1)[1].sum().backward()
    assert opacities.grad.item() == pytest.approx(slope)

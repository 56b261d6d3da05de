"""Single pixels render as they do in the whole image, and take the same gradients."""

import pytest
import torch

from egosplat.rasterize.api import rasterization
from egosplat.rasterize.view import View, pixel_renderer

WIDTH, HEIGHT = 75, 50
K = torch.tensor([[60.0, 0, 37], [0, 60, 25], [0, 0, 1]])


@pytest.fixture(scope="module")
def geometry():
    """Means, rotations, sizes and opacities of 400 Gaussians, some of them behind the camera."""
    generator = torch.Generator().manual_seed(0)
    means = torch.randn(400, 3, generator=generator) + torch.tensor([0.0, 0, 2.0])
    quats = torch.randn(400, 4, generator=generator)
    scales = 0.02 + 0.2 * torch.rand(400, 3, generator=generator)
    return means, quats, scales, torch.rand(400, generator=generator)


@pytest.mark.parametrize("backend", ["cpu", "reference"])
@pytest.mark.parametrize("mode", ["classic", "antialiased"])
def test_pixels_are_those_of_the_image(geometry, backend, mode):
    options = {"rasterize_mode": mode, "backend": backend}
    generator = torch.Generator().manual_seed(1)
    values = torch.randn(400, 5, generator=generator).requires_grad_()
    size = torch.tensor([WIDTH, HEIGHT])
    pixels = (torch.rand(300, 2, generator=generator) * size).long()
    pixels = torch.cat([pixels, torch.tensor([[0, 0], [WIDTH - 1, HEIGHT - 1]])])
    pull = torch.randn(302, 5, generator=generator)
    image = rasterization(*geometry, values, torch.eye(4)[None], K[None], WIDTH, HEIGHT, **options)[0][0]
    wanted = image[pixels[:, 1], pixels[:, 0]]
    found = pixel_renderer(View(*geometry, torch.eye(4), K, WIDTH, HEIGHT, **options), pixels)(values)
    assert float(wanted.detach().abs().max()) > 0.5
    torch.testing.assert_close(found, wanted, rtol=1e-4, atol=1e-5)
    gradients = [torch.autograd.grad((one * pull).sum(), values)[0] for one in (found, wanted)]
    torch.testing.assert_close(*gradients, rtol=1e-4, atol=1e-5)


def test_a_scene_of_many_layers_needs_more_room_than_guessed():
    means, quats = torch.zeros(300, 3), torch.tensor([[1.0, 0, 0, 0]]).repeat(300, 1)
    means[:, 2] = torch.linspace(1, 2, 300)
    geometry = means, quats, torch.full((300, 3), 5.0), torch.full((300,), 0.01)
    pixels = torch.tensor([[37, 25]])
    values = torch.ones(300, 1)
    found = pixel_renderer(View(*geometry, torch.eye(4), K, WIDTH, HEIGHT, backend="cpu"), pixels)(values)
    assert float(found) == pytest.approx(1 - 0.99**300, rel=1e-3)


def test_a_pixel_outside_the_image_is_an_error(geometry):
    view = View(*geometry, torch.eye(4), K, WIDTH, HEIGHT, backend="cpu")
    with pytest.raises(ValueError, match="outside"):
        pixel_renderer(view, torch.tensor([[WIDTH, 0]]))

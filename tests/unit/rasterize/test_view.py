"""What a view composites of sparse values, at single pixels and over all pixels is what the renderer has."""

import numpy as np
import pytest
import torch
from scipy import sparse
from torch import Tensor

from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.geometry import Camera
from egosplat.rasterize import api
from egosplat.rasterize.view import View, composite_sparse, pixel_renderer, sum_over_pixels
from tests.support.splats import blobs, colorful, crowd

COUNT, CHANNELS = 300, 70
# The last tiles reach beyond the image.
CAMERA = Camera(67, 41, 50.0, 50.0, 33.0, 20.0)
CROWD = colorful(crowd(), 0)
CROWD.means[-1] = torch.nan
BACKENDS = pytest.mark.parametrize("backend", ["cpu", "reference"])


def view(gaussians=CROWD, backend: str = "cpu") -> View:
    return view_of(gaussians, CAMERA, np.eye(4), RenderSettings(0.1, "black", backend))


def rendered(shown: View, values: Tensor) -> Tensor:
    """(H, W, X) by the renderer."""
    shape = shown.means, shown.quats, shown.scales, shown.opacities
    camera = shown.viewmats, shown.Ks, shown.width, shown.height
    return api.rasterization(*shape, values, *camera, backend=shown.backend)[0][0]


def values_of(density: float) -> sparse.csr_array:
    return sparse.random_array((COUNT, CHANNELS), density=density, rng=1, dtype=np.float32).tocsr()


@BACKENDS
def test_sparse_values_are_rendered_as_dense_ones(backend):
    held = values_of(0.03)
    found = composite_sparse(view(backend=backend), held)
    wanted = rendered(view(backend=backend), torch.from_numpy(held.toarray()))
    assert found.shape == (CHANNELS, 41, 67) and int((found > 0.01).sum()) > 1000
    torch.testing.assert_close(found, wanted.permute(2, 0, 1), rtol=1e-5, atol=1e-7)


def test_the_number_of_threads_does_not_change_a_bit(with_threads):
    assert torch.equal(*(with_threads(count, composite_sparse, view(), values_of(0.1)) for count in (1, 3)))


def test_gaussians_without_values_hide_what_is_behind_them():
    """Two blobs in a row: the first has no value."""
    row = blobs([[0.0, 0.0, 2.0], [0.0, 0.0, 3.0]], [0.4, 0.9])
    held = sparse.csr_array(np.array([[0.0], [1.0]], np.float32))
    assert float(composite_sparse(view(row, "auto"), held).max()) == pytest.approx(0.6 * 0.9, rel=0.03)


@pytest.mark.parametrize(
    ("begin", "channel", "value"),
    [
        ([0, 1], [0], [1.0]),
        ([0, 1, 2, 4], [0, 0, 0], [1.0, 1.0, 1.0]),
        ([0, 2, 1, 3], [0, 0, 0], [1.0, 1.0, 1.0]),
        ([0, 1, 2, 3], [0, 0, 2], [1.0, 1.0, 1.0]),
        ([0, 1, 2, 3], [0, -1, 0], [1.0, 1.0, 1.0]),
        ([0, 1, 2, 3], [0, 0, 0], [1.0, 1.0]),
        ([0, 1, 2, 3], [0, 0, 0], [1, 1, 1]),
    ],
)
def test_rows_of_another_matrix_are_refused(begin, channel, value):
    three = blobs([[0.0, 0.0, 2.0]] * 3, [0.5] * 3)
    held = sparse.csr_array((3, 2), dtype=np.float32)
    held.indptr, held.indices = np.array(begin, np.int32), np.array(channel, np.int32)
    held.data = np.array(value, np.int64 if isinstance(value[0], int) else np.float32)
    with pytest.raises(ValueError, match="3 x 2"):
        composite_sparse(view(three, "auto"), held)


@BACKENDS
def test_pixels_are_those_of_the_image(backend):
    generator = torch.Generator().manual_seed(1)
    values = torch.randn(COUNT, 5, generator=generator).requires_grad_()
    pixels = (torch.rand(300, 2, generator=generator) * torch.tensor([67, 41])).long()
    pixels = torch.cat([pixels, torch.tensor([[0, 0], [66, 40]])])
    pull = torch.randn(302, 5, generator=generator)
    shown = view(backend=backend)
    wanted = rendered(shown, values)[pixels[:, 1], pixels[:, 0]]
    found = pixel_renderer(shown, pixels)(values)
    assert float(wanted.detach().abs().max()) > 0.5
    torch.testing.assert_close(found, wanted, rtol=1e-4, atol=1e-5)
    gradients = [torch.autograd.grad((each * pull).sum(), values)[0] for each in (found, wanted)]
    torch.testing.assert_close(*gradients, rtol=1e-4, atol=1e-5)


def test_a_scene_of_many_layers_needs_more_room_than_guessed():
    depths = torch.linspace(1, 2, 300)
    layers = blobs([[0.0, 0.0, float(depth)] for depth in depths], [0.01] * 300, size=5.0)
    found = pixel_renderer(view(layers), torch.tensor([[33, 20]]))(torch.ones(300, 1))
    assert float(found) == pytest.approx(1 - 0.99**300, rel=1e-3)


@BACKENDS
@pytest.mark.parametrize("channels", [1, 16, 33])
def test_sums_over_pixels_are_the_gradient_of_a_render_to_the_bit(channels, backend):
    """The kernels sum without rendering; results must not depend on that."""
    planes = torch.randn(channels, 41, 67, generator=torch.Generator().manual_seed(1))
    for image in (planes.permute(1, 2, 0), planes.permute(1, 2, 0).contiguous()):
        values = torch.zeros(COUNT, channels, requires_grad=True)
        expected = torch.autograd.grad(rendered(view(backend=backend), values), values, image)[0]
        found = sum_over_pixels(view(backend=backend), image)
        assert torch.equal(found, expected) and found.any(dim=1).sum() > 50 and not found[-1].any()


def test_what_does_not_fit_the_view_is_refused():
    for backend in ("cpu", "reference"):
        with pytest.raises(ValueError, match="outside"):
            pixel_renderer(view(backend=backend), torch.tensor([[0, 0], [66, -1]]))
    with pytest.raises(ValueError, match="300 x 70"):
        composite_sparse(view(), values_of(0.1)[:299])
    for image in (torch.ones(41, 67), torch.ones(67, 41, 1), torch.ones(41, 67, 1, dtype=torch.float64)):
        with pytest.raises(ValueError, match="image"):
            sum_over_pixels(view(), image)

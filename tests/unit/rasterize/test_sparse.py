"""Sparse values are rendered as the dense ones."""

import numpy as np
import pytest
import torch
from scipy import sparse

from egosplat.codes.rendering import render_sparse_values, render_values
from egosplat.gaussians.model import Gaussians
from egosplat.gaussians.render import RenderSettings
from egosplat.geometry import Camera
from egosplat.rasterize.api import sparse_values
from tests.support.blobs import blobs

COUNT, CHANNELS = 300, 70
# The last tiles reach beyond the image.
CAMERA = Camera(67, 41, 50.0, 50.0, 33.0, 20.0)


@pytest.fixture(scope="module")
def crowd() -> Gaussians:
    """Gaussians before and behind the camera, some of which end pixels."""
    generator = torch.Generator().manual_seed(3)
    means = torch.randn(COUNT, 3, generator=generator) + torch.tensor([0.0, 0.0, 2.5])
    opacities = 0.05 + 0.945 * torch.rand(COUNT, generator=generator)
    return blobs(means.tolist(), opacities.tolist(), size=0.1)


def values_of(density: float) -> sparse.csr_array:
    return sparse.random_array((COUNT, CHANNELS), density=density, rng=1, dtype=np.float32).tocsr()


@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_sparse_values_are_rendered_as_dense_ones(crowd, backend):
    held = values_of(0.03)
    settings = RenderSettings(near_plane=0.1, background="black", antialiased=False, backend=backend)
    found = render_sparse_values(crowd, held, CAMERA, np.eye(4), settings)
    wanted, _ = render_values(crowd, torch.from_numpy(held.toarray()), CAMERA, np.eye(4), settings)
    assert found.shape == (CHANNELS, 41, 67) and int((found > 0.01).sum()) > 1000
    torch.testing.assert_close(found, wanted.permute(2, 0, 1), rtol=1e-5, atol=1e-7)


def test_the_number_of_threads_does_not_change_a_bit(crowd):
    settings = RenderSettings(near_plane=0.1, background="black", antialiased=False, backend="cpu")
    threads, images = torch.get_num_threads(), []
    try:
        for count in (1, 3):
            torch.set_num_threads(count)
            images.append(render_sparse_values(crowd, values_of(0.1), CAMERA, np.eye(4), settings))
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(*images)


def test_gaussians_without_values_hide_what_is_behind_them(crowd):
    """Two blobs in a row: the first has no value."""
    row = blobs([[0.0, 0.0, 2.0], [0.0, 0.0, 3.0]], [0.4, 0.9])
    settings = RenderSettings(near_plane=0.1, background="black", antialiased=False, backend="cpu")
    held = sparse.csr_array(np.array([[0.0], [1.0]], np.float32))
    assert float(render_sparse_values(row, held, CAMERA, np.eye(4), settings).max()) == pytest.approx(
        0.6 * 0.9, rel=0.03
    )


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
    geometry = three.means, three.quats, three.scales, three.opacities
    rows = torch.tensor(begin), torch.tensor(channel), torch.tensor(value)
    view = torch.eye(4), torch.from_numpy(CAMERA.matrix).float(), 67, 41
    with pytest.raises(ValueError, match="3 x 2"):
        sparse_values(*geometry, *rows, 2, *view)

"""Sparse values are rendered as the dense ones."""

import numpy as np
import pytest
import torch
from scipy import sparse

from egosplat.gaussians.render import RenderSettings, view_of
from egosplat.geometry import Camera
from egosplat.rasterize.view import composite, composite_sparse
from tests.support.blobs import blobs, crowd

COUNT, CHANNELS = 300, 70
# The last tiles reach beyond the image.
CAMERA = Camera(67, 41, 50.0, 50.0, 33.0, 20.0)


CROWD = crowd()


def settings(backend: str) -> RenderSettings:
    return RenderSettings(near_plane=0.1, background="black", antialiased=False, backend=backend)


def values_of(density: float) -> sparse.csr_array:
    return sparse.random_array((COUNT, CHANNELS), density=density, rng=1, dtype=np.float32).tocsr()


@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_sparse_values_are_rendered_as_dense_ones(backend):
    held = values_of(0.03)
    view = view_of(CROWD, CAMERA, np.eye(4), settings(backend))
    found = composite_sparse(view, held)
    wanted, _ = composite(view, torch.from_numpy(held.toarray()))
    assert found.shape == (CHANNELS, 41, 67) and int((found > 0.01).sum()) > 1000
    torch.testing.assert_close(found, wanted.permute(2, 0, 1), rtol=1e-5, atol=1e-7)


def test_the_number_of_threads_does_not_change_a_bit(with_threads):
    view = view_of(CROWD, CAMERA, np.eye(4), settings("cpu"))
    assert torch.equal(*(with_threads(count, composite_sparse, view, values_of(0.1)) for count in (1, 3)))


def test_gaussians_without_values_hide_what_is_behind_them():
    """Two blobs in a row: the first has no value."""
    row = blobs([[0.0, 0.0, 2.0], [0.0, 0.0, 3.0]], [0.4, 0.9])
    held = sparse.csr_array(np.array([[0.0], [1.0]], np.float32))
    found = composite_sparse(view_of(row, CAMERA, np.eye(4), settings("auto")), held)
    assert float(found.max()) == pytest.approx(0.6 * 0.9, rel=0.03)


def test_a_matrix_of_another_number_of_gaussians_is_refused():
    with pytest.raises(ValueError, match="300 x 70"):
        composite_sparse(view_of(CROWD, CAMERA, np.eye(4), settings("cpu")), values_of(0.1)[:299])


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
        composite_sparse(view_of(three, CAMERA, np.eye(4), settings("auto")), held)

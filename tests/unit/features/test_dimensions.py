"""features.dims = auto is the smallest number of channels that reaches the bound."""

import numpy as np
import pytest

from egosplat.features.compression import SHARE, fit, needed_dims
from egosplat.features.supervision import reconstruction


def unit_rows(count: int, width: int, rank: int, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(count, rank)) @ rng.normal(size=(rank, width)) + rng.normal(size=width)
    rows += noise * rng.normal(size=rows.shape)
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


def share_of(rows: np.ndarray, dims: int, bound: float) -> float:
    """By encoding and decoding."""
    compressed = fit(rows, "linear", dims, 1, 0)
    return float((reconstruction(rows, compressed.encode(rows), compressed.decoder) >= bound).mean())


@pytest.mark.parametrize("bound", [0.9, 0.97, 0.99])
def test_auto_dims_is_the_smallest_that_reaches_the_bound(bound):
    rows = unit_rows(300, 24, 24)
    found = fit(rows, "linear", "auto", 1, 0, bound)
    dims = found.decoder.widths[0]
    assert 1 < dims < 24 and found.need.dims == dims
    assert share_of(rows, dims, bound) >= SHARE > share_of(rows, dims - 1, bound)
    for number in (1, dims - 1, dims, 24):
        assert found.need.share[number - 1] == pytest.approx(share_of(rows, number, bound), abs=0.01)


def test_features_of_few_directions_need_few_numbers():
    rows = unit_rows(200, 64, 3, noise=1e-4)
    assert fit(rows, "linear", "auto", 1, 0, 0.999).need.dims <= 4
    assert (
        fit(rows, "linear", "auto", 1, 0, 0.5).need.dims <= fit(rows, "linear", "auto", 1, 0, 0.9).need.dims
    )


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_rows_need_one_number(count):
    found = fit(unit_rows(count, 16, 16), "linear", "auto", 1, 0, 0.99)
    assert found.need.dims == 1 and found.encode(unit_rows(count, 16, 16)).shape == (count, 1)


def test_an_unreachable_bound_takes_all_dimensions():
    rows = unit_rows(50, 8, 8)
    found = needed_dims(rows, np.zeros(8), np.eye(8), 1.1)
    assert found.dims == 8


def test_an_autoencoder_takes_as_many_numbers_as_a_basis_needs():
    rows = unit_rows(50, 8, 8)
    basis, found = (fit(rows, kind, "auto", 1, 0, 0.9) for kind in ("linear", "autoencoder"))
    assert found.need.dims == basis.need.dims == found.decoder.widths[0] == found.encode(rows).shape[1]


def test_no_compression_keeps_all_channels():
    assert fit(unit_rows(50, 8, 8), "none", "auto", 1, 0, 0.9).decoder.widths == (8,)

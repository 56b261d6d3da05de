"""Codes decode to their features as well as their number of channels allows, which ``auto`` chooses."""

import numpy as np
import pytest
import torch

from egosplat.features import compression
from egosplat.features.autoencoder import BATCH, Autoencoder, _decoder_of, batches, loss
from egosplat.features.compression import SHARE, Compression, fit
from egosplat.features.supervision import cosines
from egosplat.language.decoder import Decoder, decode
from egosplat.language.vectors import unit


def rows(count: int, channels: int, rank: int, seed: int = 0) -> np.ndarray:
    """(count, channels) float32 of unit norm, in a plane of ``rank`` dimensions that misses the origin."""
    rng = np.random.default_rng(seed)
    basis, center = rng.normal(size=(rank, channels)), 5 * rng.normal(size=channels)
    return unit(rng.normal(size=(count, rank)) @ basis + center).astype(np.float32)


def test_langsplat_s_autoencoder_has_its_number_of_parameters():
    model = Autoencoder(512, 3)
    count = {name: sum(p.numel() for p in part.parameters()) for name, part in model.named_children()}
    assert count == {"encoder": 175_619, "decoder": 241_440}


def test_its_loss_takes_the_cosine_over_the_channels():
    features = torch.tensor([[1.0, 0.0], [0.0, 1.0]])
    swapped = features.flip(1)
    assert loss(features, features, 1.0) == 0.0
    # Over the batch each column's cosine would be 0, too.
    assert loss(swapped, features, 0.5) == pytest.approx(1.0 + 0.5)
    lengthened = torch.tensor([[2.0, 0.0], [0.0, 3.0]])
    assert loss(lengthened, features, 1.0) == pytest.approx((1 + 4) / 4)


@pytest.mark.parametrize("count", [1, 2, BATCH, BATCH + 1, BATCH + 2, 3 * BATCH + 1])
def test_every_row_is_in_a_batch_of_at_least_two(count):
    parts = batches(count, torch.Generator().manual_seed(0))
    assert all(len(part) > 1 for part in parts)
    assert set(torch.cat(parts).tolist()) == set(range(count))
    assert count == 1 or len(torch.cat(parts)) == count


def test_the_decoder_s_numbers_are_the_autoencoder_s():
    torch.manual_seed(3)
    model = Autoencoder(20, 2).eval()
    decoder = _decoder_of(model)
    assert decoder.widths == (2, 16, 32, 64, 128, 256, 256, 20)
    features = torch.randn(7, 20)
    with torch.no_grad():
        torch.testing.assert_close(decode(model.encode(features), decoder), model(features))
        grid = model.encode(features).reshape(7, 1, 2).double()
        assert decode(grid, decoder).shape == (7, 1, 20) and decode(grid, decoder).dtype == torch.float64


def test_a_trained_autoencoder_reconstructs_features():
    features, means = rows(200, 16, 2), []
    for epochs in (1, 40):
        fitted = fit(features, "autoencoder", 3, epochs, 0)
        means.append(reconstruction(features, fitted).mean())
    assert means[1] > 0.97 and means[1] > means[0]


def test_global_random_numbers_are_left_alone():
    torch.manual_seed(5)
    expected = torch.rand(1)
    torch.manual_seed(5)
    fit(rows(70, 10, 3), "autoencoder", 2, 1, 0)
    assert torch.rand(1) == expected


@pytest.mark.parametrize(("width", "numbers", "wrong"), [(3, 12, "3 channels"), (2, 11, "12 numbers")])
def test_codes_of_another_decoder_are_rejected(width, numbers, wrong):
    with pytest.raises(ValueError, match=wrong):
        decode(torch.zeros(1, width), Decoder((2, 4), np.zeros(numbers, np.float32)))


def test_gradients_reach_the_codes():
    features = rows(50, 12, 3)
    fitted = fit(features, "linear", 3, 1, 0)
    codes = torch.from_numpy(fitted.encode(features)).requires_grad_()
    decode(codes, fitted.decoder)[:, 0].sum().backward()
    assert codes.grad.abs().sum() > 0


def reconstruction(features: np.ndarray, fitted: Compression) -> np.ndarray:
    """Cosine of each feature with its decoded code."""
    found = decode(torch.from_numpy(fitted.encode(features)), fitted.decoder).numpy()
    return cosines(features, lambda part: found[part])


def share_of(features: np.ndarray, dims: int, bound: float) -> float:
    """By encoding and decoding."""
    fitted = fit(features, "linear", dims, 1, 0)
    return float((reconstruction(features, fitted) >= bound).mean())


def test_auto_dims_is_the_smallest_that_reaches_the_bound():
    rng, bound = np.random.default_rng(0), compression.LEAST_COSINE
    features = unit(rng.normal(size=(300, 24)) @ rng.normal(size=(24, 24))).astype(np.float32)
    found = fit(features, "linear", "auto", 1, 0)
    dims = found.decoder.widths[0]
    assert 1 < dims < 24
    assert share_of(features, dims, bound) >= SHARE > share_of(features, dims - 1, bound)


@pytest.mark.parametrize(
    ("kind", "count", "width", "rank", "bound", "least", "most"),
    [
        ("linear", 200, 64, 3, 0.999, 1, 4),
        *(("linear", few, 16, 16, 0.99, 1, 1) for few in (0, 1, 2)),
        ("linear", 50, 8, 8, 1.1, 8, 8),  # out of reach
        ("none", 50, 8, 8, 0.9, 8, 8),
    ],
)
def test_auto_dims_are_those_that_features_need(monkeypatch, kind, count, width, rank, bound, least, most):
    monkeypatch.setattr(compression, "LEAST_COSINE", bound)
    features = rows(count, width, rank)
    found = fit(features, kind, "auto", 1, 0)
    assert least <= found.decoder.widths[0] <= most
    assert found.encode(features).shape == (count, found.decoder.widths[0])


def test_an_autoencoder_takes_as_many_numbers_as_a_basis_needs():
    features = unit(np.random.default_rng(0).normal(size=(50, 8))).astype(np.float32)
    basis, found = (fit(features, kind, "auto", 1, 0) for kind in ("linear", "autoencoder"))
    assert basis.decoder.widths[0] == found.decoder.widths[0] == found.encode(features).shape[1]

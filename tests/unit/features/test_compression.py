"""Codes decode to their features as well as their number of channels allows."""

import numpy as np
import pytest
import torch

from egosplat.features.autoencoder import BATCH, Autoencoder, batches, loss
from egosplat.features.compression import fit
from egosplat.features.supervision import reconstruction, summary
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
    assert sum(count.values()) == 417_059


def test_its_loss_takes_the_cosine_over_the_channels():
    features = torch.tensor([[1.0, 0.0], [0.0, 1.0]])
    swapped = features.flip(1)
    assert loss(features, features, 1.0) == 0.0
    assert loss(swapped, features, 0.5) == pytest.approx(
        1.0 + 0.5
    )  # over the batch: each column's cosine is 0 too
    lengthened = torch.tensor([[2.0, 0.0], [0.0, 3.0]])
    assert loss(lengthened, features, 1.0) == pytest.approx(
        (1 + 4) / 4
    )  # over the batch it would be the same


@pytest.mark.parametrize("count", [1, 2, BATCH, BATCH + 1, BATCH + 2, 3 * BATCH + 1])
def test_every_row_is_in_a_batch_of_at_least_two(count):
    parts = batches(count, torch.Generator().manual_seed(0))
    assert all(len(part) > 1 for part in parts)
    assert set(torch.cat(parts).tolist()) == set(range(count))
    assert count == 1 or len(torch.cat(parts)) == count


@pytest.mark.parametrize("kind, dims", [("none", 1), ("linear", 4), ("linear", 12), ("autoencoder", 3)])
def test_codes_and_reconstructions_have_their_shapes(kind, dims):
    features = rows(150, 12, 4)
    fitted = fit(features, kind, dims, 3, 0)
    codes = fitted.encode(features)
    assert codes.dtype == np.float32 and codes.shape == (150, 12 if kind == "none" else dims)
    decoded = decode(torch.from_numpy(codes), fitted.decoder)
    torch.testing.assert_close(decoded.norm(dim=1), torch.ones(150))
    cosine = reconstruction(features, codes, fitted.decoder)
    np.testing.assert_allclose(cosine, (features * decoded.numpy()).sum(axis=1), atol=1e-6)
    if kind != "autoencoder":
        assert cosine.min() > (0.9999 if kind == "none" or dims == 12 else 0.99)


def test_the_decoder_s_numbers_are_the_autoencoder_s():
    torch.manual_seed(3)
    model = Autoencoder(20, 2).eval()
    from egosplat.features.autoencoder import _decoder_of

    decoder = _decoder_of(model)
    assert decoder.widths == (2, 16, 32, 64, 128, 256, 256, 20)
    features = torch.randn(7, 20)
    with torch.no_grad():
        torch.testing.assert_close(decode(model.encode(features), decoder), model(features))
        grid = model.encode(features).reshape(7, 1, 2).double()
        assert decode(grid, decoder).shape == (7, 1, 20) and decode(grid, decoder).dtype == torch.float64


def test_a_trained_autoencoder_reconstructs_features():
    features = rows(200, 16, 2)
    few, many = (
        reconstruction(
            features, (f := fit(features, "autoencoder", 3, epochs, 0)).encode(features), f.decoder
        )
        for epochs in (1, 40)
    )
    assert many.mean() > 0.97 and many.mean() > few.mean()


def test_global_random_numbers_are_left_alone():
    torch.manual_seed(5)
    expected = torch.rand(1)
    torch.manual_seed(5)
    fit(rows(70, 10, 3), "autoencoder", 2, 1, 0)
    assert torch.rand(1) == expected


def test_codes_of_another_decoder_are_rejected():
    with pytest.raises(ValueError, match="3 channels"):
        decode(torch.zeros(1, 3), Decoder((2, 4), np.zeros(12, np.float32)))
    with pytest.raises(ValueError, match="12 numbers"):
        decode(torch.zeros(1, 2), Decoder((2, 4), np.zeros(11, np.float32)))


def test_gradients_reach_the_codes():
    features = rows(50, 12, 3)
    fitted = fit(features, "linear", 3, 1, 0)
    codes = torch.from_numpy(fitted.encode(features)).requires_grad_()
    decode(codes, fitted.decoder)[:, 0].sum().backward()
    assert codes.grad.abs().sum() > 0


def test_the_summary_is_by_level():
    found = summary(np.array([0.5, 1.0, 0.8]), np.array([0, 0, 2]), ["subpart", "part", "whole"])
    assert found["mean"] == pytest.approx(2.3 / 3) and found["lowest"] == 0.5
    assert found["by_level"]["subpart"] == {"mean": 0.75, "lowest": 0.5}
    assert found["by_level"]["part"] == {"mean": None, "lowest": None}

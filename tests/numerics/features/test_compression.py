"""Compression of identical, missing, zero and half-precision features."""

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from egosplat.artifacts.reader import Artifact, open_artifact
from egosplat.artifacts.schemas import FEATURES
from egosplat.errors import UserError
from egosplat.features import autoencoder, stage
from egosplat.features.compression import fit
from egosplat.features.supervision import mean_cosine, spread
from egosplat.language.decoder import Decoder, decode
from egosplat.language.vectors import unit
from egosplat.pipeline.config import defaults
from tests.unit.features.conftest import put_views

WIDTH = 16
KINDS = pytest.mark.parametrize("kind", ["none", "linear", "autoencoder"])
KEYS = defaults()["features"] | {"dims": 3, "epochs": 2}


def features(seed: int, count: int) -> np.ndarray:
    """(count, 16) float32 of unit norm."""
    return unit(np.random.default_rng(seed).normal(size=(count, WIDTH))).astype(np.float32)


def run(folder: Path, rows: np.ndarray, instance: list[int], **changes: object) -> Artifact:
    """The artifact of the rows, of instances up to one more than the last that has a view."""
    path = put_views(folder, rows, instance, np.zeros(max(instance) + 2))
    stage.run(path, folder / "features.zarr", stage.FeaturesOptions(**KEYS | changes))
    return open_artifact(folder / "features.zarr", FEATURES)


def decoded(rows: np.ndarray, kind: str, dims: int) -> np.ndarray:
    """The rows from their codes."""
    compression = fit(rows, kind, dims, 2, 0)
    codes = compression.encode(rows)
    assert codes.dtype == np.float32 and np.isfinite(codes).all()
    return decode(torch.from_numpy(codes), compression.decoder).numpy()


@pytest.mark.numerics(
    "linear codes of all channels: 20 to 100 features of length 1e-6 to 1e6, reconstructed", within=3e-6
)
@given(seed=st.integers(0, 999), count=st.integers(20, 100), exponent=st.floats(-6, 6))
def test_a_full_basis_loses_nothing(measured, seed, count, exponent):
    rows = features(seed, count) * np.float32(10.0**exponent)
    measured(np.abs(decoded(rows, "linear", WIDTH) - unit(rows)).max())


@pytest.mark.numerics("linear codes of 3 channels: squared error, against the best basis", within=1e-6)
@given(seed=st.integers(0, 999), count=st.integers(10, 100))
def test_the_basis_is_the_best(measured, seed, count):
    rows = features(seed, count).astype(np.float64)
    compression = fit(rows.astype(np.float32), "linear", 3, 1, 0)
    basis, mean = np.split(compression.decoder.values.astype(np.float64), [3 * WIDTH])
    codes = compression.encode(rows.astype(np.float32)).astype(np.float64)
    error = ((codes @ basis.reshape(WIDTH, 3).T + mean - rows) ** 2).sum()
    best = (np.linalg.svd(rows - rows.mean(axis=0), compute_uv=False)[3:] ** 2).sum()
    measured(abs(error - best) / best)


@pytest.mark.numerics(
    "70 identical features, one, 70 zeros, none", within=2e-7, outside="codes 0, decoded to the mean"
)
@KINDS
@pytest.mark.parametrize(
    "rows",
    [np.repeat(features(1, 1), 70, axis=0), features(2, 1), np.zeros((70, WIDTH)), np.zeros((0, WIDTH))],
    ids=["identical", "one", "zero", "none"],
)
def test_features_that_do_not_differ(measured, kind, rows):
    rows = rows.astype(np.float32)
    found = decoded(rows, kind, 3)
    assert np.isfinite(found).all()
    known = kind != "autoencoder" and rows.size
    measured(np.abs(found - unit(rows)).max() if known else 0.0)


@pytest.mark.numerics("two opposite features, whose mean is 0", within=2e-6)
def test_a_mean_of_zero(measured):
    rows = np.concatenate([features(3, 1), -features(3, 1)])
    measured(np.abs(decoded(rows, "linear", 1) - rows).max())


@pytest.mark.numerics(
    "linear codes of float16 features, against float32", within=0.0, outside="autoencoder: float32 only"
)
def test_half_precision(measured):
    rows = features(4, 50).astype(np.float16)
    codes = [fit(given_, "linear", 3, 1, 0).encode(given_) for given_ in (rows, rows.astype(np.float32))]
    measured(np.abs(codes[0] - codes[1]).max())
    with pytest.raises(RuntimeError, match="same dtype"):
        fit(rows, "autoencoder", 3, 1, 0)


@pytest.mark.numerics(
    "decoded codes: 0, length of 1e-30 to 1e15, beyond float32",
    within=3e-7,
    outside="vanishing feature: 0; queries reject infinite codes",
)
@given(exponent=st.floats(-30, 15))
def test_codes_of_any_length(measured, exponent):
    values = np.append(np.random.default_rng(0).normal(size=24), np.zeros(8)).astype(np.float32)
    decoder = Decoder((3, 8), values)
    codes = torch.tensor([[0.3, -0.2, 0.9]]) * 10.0**exponent
    # Shorter than 1e-12, what torch normalizes is left as short as it is.
    measured(float((decode(codes, decoder) - decode(codes.double(), decoder)).abs().max()))
    assert not decode(torch.zeros(1, 3), decoder).any()


@pytest.mark.numerics("more dimensions than channels", outside="UserError names features.dims")
def test_too_many_dimensions():
    with pytest.raises(UserError, match="features.dims = 17"):
        fit(features(0, 5), "linear", WIDTH + 1, 1, 0)


@pytest.mark.numerics("autoencoder whose loss is NaN", outside="UserError recommends linear codes")
def test_an_autoencoder_that_diverges(monkeypatch):
    real = autoencoder.loss
    monkeypatch.setattr(autoencoder, "loss", lambda *given_: real(*given_) * float("nan"))
    with pytest.raises(UserError, match="diverged.*linear"):
        fit(features(0, 70), "autoencoder", 3, 2, 0)


@pytest.mark.numerics("quality of one instance, and of none", outside="None, not NaN")
def test_figures_of_too_few():
    assert spread(features(0, 1)) is None and spread(features(0, 0)) is None
    nothing = features(0, 0)
    assert mean_cosine(nothing, lambda part: nothing[part]) is None


@pytest.mark.numerics(
    "stage: identical or opposite views; instances with one view and none", outside="no NaN in the artifact"
)
@KINDS
@pytest.mark.parametrize("target", ["average", "consistent", "view"])
def test_the_stage(tmp_path, kind, target):
    rows = features(7, 9)
    rows[:4] = rows[0]
    rows[5] = -rows[4]
    made = run(tmp_path, rows, [2, 2, 2, 2, 3, 3, 4, 5, 5], compression=kind, supervision=target)
    for name in ("consistent", "supervision", "code", "consistent_code", "decoder/values"):
        assert np.isfinite(made.read(name)).all(), name
    assert made.read("views").tolist() == [0, 0, 4, 2, 1, 2, 0]


@pytest.mark.numerics(
    "number to store that is not finite", outside="UserError names the array; nothing is written"
)
def test_stage_writes_nothing_when_a_value_is_not_finite(tmp_path):
    with pytest.raises(UserError, match="'consistent' must be finite"):
        run(tmp_path, np.full((2, WIDTH), np.nan, np.float32), [0, 0], compression="none")
    assert not (tmp_path / "features.zarr").exists()

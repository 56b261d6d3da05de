"""Stage features aggregates, supervises and compresses."""

import numpy as np
import pytest
import torch

from egosplat.artifacts.reader import verify
from egosplat.artifacts.schemas import SCHEMAS
from egosplat.features import stage
from egosplat.features.aggregation import aggregate
from egosplat.features.autoencoder import fit_autoencoder
from egosplat.features.supervision import mean_cosine, supervise
from egosplat.language.decoder import decode, read_decoder
from egosplat.language.vectors import unit
from egosplat.pipeline.config import defaults
from tests.unit.features.conftest import put_views

KEYS = defaults()["features"] | {"dims": 3, "epochs": 2}
INSTANCE = [0] * 7 + [2] * 2 + [3]
LEVEL = [1, 0, 0, 0]


@pytest.fixture
def feature() -> np.ndarray:
    """(10, 6): seven views of instance 0, the last of something else, two of 2, one of 3; none of 1."""
    rng = np.random.default_rng(0)
    rows = np.concatenate(
        [np.tile(np.eye(6)[0], (6, 1)), np.eye(6)[1:2], np.tile(np.eye(6)[2:4].sum(0), (2, 1)), np.eye(6)[5:]]
    )
    return unit(rows + 0.05 * rng.normal(size=rows.shape)).astype(np.float32)


@pytest.fixture
def run(tmp_path, feature):
    """``run(feature=, instance=, level=, **changes)``: the verified artifact."""

    def call(feature=feature, instance=INSTANCE, level=LEVEL, **changes):
        path = put_views(tmp_path, feature, instance, level)
        stage.run(path, tmp_path / "features.zarr", stage.FeaturesOptions(**KEYS | changes))
        return verify(tmp_path / "features.zarr", SCHEMAS)

    return call


def test_an_outlier_view_is_left_out(run, feature):
    features = run()
    assert features.read("views").tolist() == [7, 0, 2, 1]
    assert features.read("inlier").tolist()[6:] == [False, True, True, True]
    consistent = features.read("consistent")
    assert consistent[0, 0] > 0.99 and (consistent[1] == 0).all()
    np.testing.assert_allclose(consistent[3], feature[9], atol=1e-7)
    assert features.facts["outliers"] >= 1


def test_supervision_is_the_average_of_unit_norm_the_view_or_the_consistent_feature(run, feature):
    features = run(set="published")
    consistent, supervision = features.read("consistent"), features.read("supervision")
    np.testing.assert_allclose(np.linalg.norm(supervision, axis=1), 1.0, rtol=1e-6)
    np.testing.assert_allclose(supervision[8], unit(feature[8] + consistent[2]), atol=1e-6)
    np.testing.assert_allclose(supervision[6], consistent[0], atol=1e-6)  # an outlier
    kept_half = run(set="published", supervision="average").read("supervision")
    np.testing.assert_allclose(kept_half[6], unit(feature[6] + consistent[0]), atol=1e-6)
    np.testing.assert_allclose(run(supervision="view").read("supervision"), feature, atol=1e-6)
    alone = run(supervision="consistent").read("supervision")
    np.testing.assert_allclose(alone, consistent[INSTANCE], atol=1e-6)


def test_a_mismatched_view_keeps_its_own_feature(run, feature):
    features = run()
    consistent, supervision = features.read("consistent"), features.read("supervision")
    cosine = (unit(feature) * consistent[features.read("instance")]).sum(axis=1)
    apart = features.facts["spread"]["features"]
    slipped = cosine < (1 + apart) / 2
    assert slipped[6] and 0 < slipped.sum() == features.facts["slipped"] < len(feature)
    np.testing.assert_allclose(supervision[slipped], unit(feature[slipped]), atol=1e-6)
    kept = ~slipped & features.read("inlier")
    mixed = unit(unit(feature) + consistent[features.read("instance")])
    np.testing.assert_allclose(supervision[kept], mixed[kept], atol=1e-6)


def test_the_paper_s_reference_value():
    """Values 0, 1, 2, 3, 10: the consistent one is 1.5, the average of 10 is 5.75 (docs/method.md#supervision)."""
    feature = np.array([[0.0], [1.0], [2.0], [3.0], [10.0]])
    found = aggregate(feature, np.zeros(5, int), 1, "element", 3.0)
    own = supervise(feature, found.feature[[0]], found.inlier, np.zeros(5, bool), "average")
    assert found.feature.tolist() == [[1.5]] and own[4].tolist() == [5.75]


@pytest.mark.parametrize("compression", ["linear", "autoencoder", "none"])
def test_codes_decode_with_what_the_artifact_holds(run, compression):
    features = run(compression=compression, dims=4)
    decoder = read_decoder(features)
    cosines = []
    for codes, meant in (("code", "supervision"), ("consistent_code", "consistent")):
        decoded = decode(torch.from_numpy(features.read(codes)), decoder).numpy()
        seen = np.linalg.norm(features.read(meant), axis=1) > 0
        cosines.append((decoded * features.read(meant)).sum(axis=1)[seen])
    assert features.facts["reconstruction"]["mean"] == pytest.approx(cosines[0].mean(), abs=1e-6)
    assert cosines[0].mean() > (0.99 if compression == "linear" else 0.999 if compression == "none" else -1)
    assert (features.read("consistent_code")[1] == 0).all()
    means = features.read("consistent")[[0, 2, 3]]
    apart = (means @ means.T)[np.triu_indices(3, 1)].mean()
    assert features.facts["spread"]["features"] == pytest.approx(apart, abs=1e-6)
    if compression == "none":
        assert features.facts["spread"]["decoded"] == pytest.approx(apart, abs=1e-6)


def test_a_mean_cosine_is_of_rows_of_any_norm():
    views = np.array([[2.0, 0.0], [0.0, 1.0], [-1.0, 0.0]], np.float32)
    consistent = np.array([[1.0, 0.0], [0.0, 3.0]], np.float32)
    assert mean_cosine(views[:2], lambda part: consistent[part]) == 1.0
    assert mean_cosine(views, lambda part: consistent[[0, 0, 0]][part]) == 0.0
    assert mean_cosine(views[:0], lambda part: views[part]) is None


@pytest.mark.parametrize("compression", ["linear", "autoencoder", "none"])
@pytest.mark.parametrize("instance, level", [([], []), ([], [0, 1]), ([0], [1])])
def test_features_of_very_few_views_are_finite(run, compression, instance, level):
    feature = unit(np.ones((len(instance), 6)))
    features = run(feature, instance, level, compression=compression)
    assert features.shape("consistent") == (len(level), 6)
    assert features.facts["spread"] == {"features": None, "decoded": None}
    assert all(np.isfinite(features.read(name)).all() for name in features.schema.fields)


def test_equal_runs_are_equal(run):
    digests = [run(compression="autoencoder", seed=seed).digest for seed in (0, 0, 1)]
    assert digests[0] == digests[1] != digests[2]


def test_any_number_of_threads_makes_the_same_codes(with_threads):
    """Rows are so wide and many that PyTorch would split the work over threads."""
    rows = np.random.default_rng(0).normal(size=(3000, 512)).astype(np.float32)

    def train():
        encode, decoder = fit_autoencoder(rows, 16, epochs=1, seed=0)
        return torch.get_num_threads(), *encode(rows).ravel(), *decoder.values

    one, two = (with_threads(threads, train) for threads in (1, 2))
    assert (one[0], two[0]) == (1, 2) and one[1:] == two[1:]

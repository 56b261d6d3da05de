"""Aggregation follows the paper's formula, also for few, equal, or mostly wrong views."""

import numpy as np
import pytest

from egosplat.features.aggregation import NORMS, disagreement, robust_mean


@pytest.mark.parametrize(
    "values, kept, mean",
    [
        ((1, 1, 1, 1, 5), (True, True, True, True, False), 1.0),  # a MAD of 0 keeps what equals the median
        ((0, 1, 2, 3, 10), (True, True, True, True, False), 1.5),
        ((0, 1, 2, 5, 10), (True, True, True, True, False), 2.0),  # median deviation 2: |10 - 2| = 8 > 6
        ((0, 1, 2, 4, 8), (True, True, True, True, True), 3.0),  # exactly at the threshold counts
        ((4.0,), (True,), 4.0),
        ((0.0, 10.0), (True, True), 5.0),
        ((0, 2, 4, 30), (True, True, True, False), 2.0),  # median 3, deviations 3, 1, 1, 27: MAD 2
        ((7, 7, 7), (True, True, True), 7.0),
    ],
)
def test_outliers_of_known_values_are_left_out(values, kept, mean):
    found, inlier = robust_mean(np.array(values, np.float64)[None, :, None], "element", 3.0)
    assert inlier[0].tolist() == list(kept)
    assert found[0, 0] == pytest.approx(mean, rel=1e-15)


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("scale", [1e-38, 1e-20, 1.0, 1e20, 1e38])
def test_the_scale_of_features_does_not_matter(norm, scale):
    values = np.random.default_rng(3).normal(size=(2, 9, 16)).astype(np.float32).astype(np.float64)
    usual, kept = robust_mean(values, norm, 3.0)
    scaled, kept_scaled = robust_mean(values * scale, norm, 3.0)
    np.testing.assert_allclose(scaled, usual * scale, rtol=1e-9)
    assert (kept == kept_scaled).all()
    lengths = np.array([[[1, 0.1], [5, 0], [0.2, 0.0], [1, -0.1], [0.1, 1]]], float)
    assert robust_mean(lengths, "cosine", 3.0)[1][0].tolist() == [True, True, True, True, False]


@pytest.mark.parametrize("count", [1, 2, 3, 8, 31])
@pytest.mark.parametrize("norm", ["element", "none"])
def test_a_view_is_an_inlier_if_its_disagreement_is_within_the_limit(norm, count):
    """The number drawn above a view on the sheet is the one that decided, to the last bit."""
    rng = np.random.default_rng(count)
    for scale in (0.0, 1e-20, 1.0):
        views = (rng.normal(size=(count, 6)) * scale * rng.choice([1, 1, 9], (count, 1))).astype(np.float32)
        number, limit = disagreement(views, norm, 1.5)
        assert ((number <= limit) == robust_mean(views[None], norm, 1.5)[1][0]).all()

"""Consistent features of identical, single, zero, half-precision and very many views."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from egosplat.features.aggregation import aggregate, robust_mean
from egosplat.features.supervision import consistent_directions, supervise
from egosplat.language.vectors import unit, usable

EACH_NORM = pytest.mark.parametrize("norm", ["element", "none"])
K = 3.0


def views(seed: int, *shape: int) -> np.ndarray:
    """Float32 features of unit norm."""
    return unit(np.random.default_rng(seed).normal(size=shape)).astype(np.float32)


def exact(rows: np.ndarray, norm: str, k: float) -> np.ndarray:
    """The consistent feature of (V, D) views in extended precision, from the formula alone."""
    rows = rows.astype(np.longdouble)
    center = np.median(rows, axis=0)
    if norm == "none":
        return rows.mean(axis=0)
    deviation = np.abs(rows - center)
    kept = deviation <= k * np.median(deviation, axis=0)
    return (rows * kept).sum(axis=0) / kept.sum(axis=0)


@pytest.mark.numerics("2 to 40 views, 1 to 64 channels, k of 1 to 10, each norm", within=1e-14)
@EACH_NORM
@given(seed=st.integers(0, 999), count=st.integers(2, 40), width=st.integers(1, 64), k=st.floats(1, 10))
def test_aggregate_matches_exact_arithmetic(measured, norm, seed, count, width, k):
    rows = views(seed, count, width)
    found, _ = robust_mean(rows[None], norm, k)
    measured(np.abs(found[0] - exact(rows, norm, k)).max())


def case(rows: np.ndarray, tried: str, within: float, outside: str = "", inlier: list[bool] | None = None):
    mark = pytest.mark.numerics(tried, within=within, outside=outside)
    return pytest.param(rows, inlier, marks=mark, id=f"{tried}, {len(rows)}")


SAME, OTHER = views(1, 2, 32)
ZEROS = "zero features among others", 1e-14, "only zeros: feature 0"


@EACH_NORM
@pytest.mark.parametrize(
    ("rows", "inlier"),
    [
        *(
            case(
                SAME[None].repeat(count, 0), "2 to 1000 identical views", 2e-14, "all inliers", [True] * count
            )
            for count in (2, 3, 1000)
        ),
        case(SAME[None], "one view", 0.0, "returned", [True]),
        case(
            np.stack([SAME] * 4 + [OTHER]),
            *("all views identical but one", 1e-14, "it is an outlier"),
            inlier=[True] * 4 + [False],
        ),
        case(np.concatenate([views(2, 6, 16), np.zeros((1, 16), np.float32)]), *ZEROS),
        case(np.zeros((5, 16), np.float32), *ZEROS, inlier=[True] * 5),
        case(
            (views(4, 9, 16) * 65504).astype(np.float16),
            "float16 views up to 65504, the largest number",
            1e-10,
        ),
    ],
)
def test_extreme_views(measured, norm, rows, inlier):
    found, kept = robust_mean(rows[None], norm, K)
    assert inlier is None or kept[0].tolist() == (inlier if norm != "none" else [True] * len(rows))
    measured(np.abs(found[0] - exact(rows, norm, K)).max())


@pytest.mark.numerics("no view", outside="feature 0, count 0")
def test_an_instance_without_views_gets_zeros():
    found = aggregate(views(0, 2, 8), np.array([0, 2]), 3, "element", K)
    assert found.views.tolist() == [1, 0, 1] and not found.feature[1].any()
    none = aggregate(np.zeros((0, 8), np.float32), np.zeros(0, int), 2, "element", K)
    assert none.feature.shape == (2, 8) and not none.feature.any() and len(none.inlier) == 0


@pytest.mark.numerics(
    "features of 0, NaN, infinity; others of 1e-45 to 3e38",
    within=1e-14,
    outside="0, NaN, infinity: left out",
)
@given(exponent=st.floats(-37, 38))
def test_which_features_are_usable(measured, exponent):
    rows = (views(3, 1, 16).astype(np.float64) * 10.0**exponent).astype(np.float32)
    assert usable(rows).all()
    exact_rows = rows.astype(np.longdouble)
    measured(float(np.abs(unit(rows) - exact_rows / np.sqrt((exact_rows**2).sum())).max()))
    broken = np.array([[0.0, 0.0], [np.nan, 1.0], [1.0, np.inf], [0.0, 1e-45]], np.float32)
    assert usable(broken).tolist() == [False, False, False, True]
    assert unit(broken[[0, 3]]).tolist() == [[0.0, 0.0], [0.0, 1.0]]


@pytest.mark.numerics(
    "float16 views, against extended precision", within=1e-14, outside="computed in float64"
)
@EACH_NORM
@given(seed=st.integers(0, 999), count=st.integers(2, 40))
def test_half_precision(measured, norm, seed, count):
    rows = views(seed, count, 32).astype(np.float16)
    found, _ = robust_mean(rows[None], norm, K)
    assert found.dtype == np.float64
    measured(np.abs(found[0] - exact(rows, norm, K)).max())


@pytest.mark.numerics("1 and 1e5 instances with 1 to 3 views each", within=1e-14)
@EACH_NORM
@pytest.mark.parametrize("count", [1, 100_000])
def test_one_and_very_many_instances(measured, norm, count):
    number = np.arange(count) % 3 + 1
    instance = np.repeat(np.arange(count), number)
    rows = views(5, len(instance), 8)
    found = aggregate(rows, instance, count, norm, K)
    assert np.isfinite(found.feature).all() and (found.views == number).all()
    for one in range(0, count, 997):
        own = rows[instance == one]
        assert (robust_mean(own[None], norm, K)[1][0] == found.inlier[instance == one]).all()
        measured(np.abs(found.feature[one] - exact(own, norm, K)).max())


@pytest.mark.numerics("k below 1, NaN; unknown norm", outside="ValueError")
@pytest.mark.parametrize(("norm", "k"), [("element", 0.99), ("element", np.nan), ("median", 3.0)])
def test_invalid_views_are_rejected(norm, k):
    with pytest.raises(ValueError, match="at least 1"):
        aggregate(views(0, 2, 4), np.array([0, 0]), 1, norm, k)


@pytest.mark.numerics(
    "opposite views, whose mean is rounding error",
    within=1e-7,
    outside="first view's direction; a target that cancels: consistent feature",
)
def test_views_that_cancel(measured):
    first = views(6, 1, 32)
    rows = np.concatenate([first, -first])
    mean, _ = robust_mean(rows[None], "none", K)
    direction = consistent_directions(mean, rows, np.zeros(2, int))
    measured(np.abs(direction[0] - first[0]).max())
    mixed = supervise(rows, direction[[0, 0]], np.ones(2, bool), np.zeros(2, bool), "inliers")
    assert np.linalg.norm(mixed[1]) < 1e-6 and np.isfinite(unit(mixed)).all()

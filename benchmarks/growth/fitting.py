"""Fit laws of few terms with non-negative coefficients, by least squares of relative errors, and report their errors."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from egosplat.cost_model.laws import Term, evaluate

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Fit:
    """A fitted law, ``sum of coefficient x product of sizes``.

    Attributes:
        coefficients: by term, at least 0.
        errors: (law - measured) / measured at each point.
        left_out: the same error of the law that is fitted without that point.
        without: the coefficients of those laws.
    """

    coefficients: Mapping[Term, float]
    errors: tuple[float, ...]
    left_out: tuple[float, ...]
    without: tuple[Mapping[Term, float], ...]

    def at(self, sizes: Mapping[str, float]) -> float:
        """The value of the law."""
        return evaluate(self.coefficients, sizes)

    def between(self, sizes: Mapping[str, float]) -> tuple[float, float]:
        """The smallest and the largest value of the laws that are fitted without one of the points."""
        found = [evaluate(law, sizes) for law in self.without]
        return min(found), max(found)


def fit(
    terms: Sequence[Term],
    sizes: Sequence[Mapping[str, float]],
    measured: Sequence[float],
    known: Mapping[Term, float] | None = None,
) -> Fit:
    """Fit a law to points.

    Args:
        terms: of the law; sizes: of each point; measured: values at each point, positive.
        known: coefficients that are not fitted.

    Raises:
        ValueError: there are fewer than two points, or a measured value is not positive.
    """
    values = np.asarray(measured, float)
    if len(values) < 2 or not (values > 0).all():
        raise ValueError("a law needs two points or more, all positive")
    design = np.array([[math.prod(own[name] for name in term) for term in terms] for own in sizes], float)
    fixed = np.array([(known or {}).get(term, np.nan) for term in terms])
    weights = _solve(design, values, fixed)
    others = [np.arange(len(values)) != index for index in range(len(values))]
    without = [_solve(design[rest], values[rest], fixed) for rest in others]
    left_out = [float(row @ law / value - 1) for row, law, value in zip(design, without, values, strict=True)]
    return Fit(
        dict(zip(terms, weights.tolist(), strict=True)),
        tuple((design @ weights / values - 1).tolist()),
        tuple(left_out),
        tuple(dict(zip(terms, law.tolist(), strict=True)) for law in without),
    )


def _solve(design: Values, values: Values, fixed: Values) -> Values:
    """Least squares of relative residuals, no coefficient below 0; ``fixed`` ones, where they are not NaN, stay."""
    relative = design / values[:, None]
    weights, free = np.nan_to_num(fixed), np.isnan(fixed)
    scale = relative[:, free].max(axis=0)
    scale[scale == 0] = 1.0  # a term without points gets the coefficient 0
    weights[free] = nnls(relative[:, free] / scale, 1.0 - relative @ weights)[0] / scale
    return weights


def median_and_worst(errors: Sequence[float]) -> tuple[float, float]:
    """Median and maximum of the errors' absolute values."""
    sizes = np.abs(errors)
    return float(np.median(sizes)), float(sizes.max())
